//! Runs `lasray render`: checks the arguments, opens the device and the data, draws one image or one a file.

use super::args::Args;
use super::data::Data;
use super::draw::{Work, draw};
use super::film::Film;
use super::names;
use super::report::{Drawn, write_json};
use crate::command::outcome::{Outcome, UsageError, usage_of_load};
use crate::command::targets::check_targets;
use crate::command::values::Place;
use crate::gpu::{Gpu, GpuError, GpuOptions};
use crate::ingest::bins::Budget;
use crate::load::{self, About, LoadError, LoadOptions};
use crate::output::{Protected, Target};
use crate::problems::Problems;
use crate::render::camera::{Camera, Projection};
use crate::render::frame::{Background, check_size};
use crate::render::image::Format;
use crate::sample::Asked;
use crate::source::inputs::{self, Inputs};
use crate::source::placement::PlacementOptions;
use std::path::PathBuf;

/// Draws.
pub fn run(args: Args, problems: &mut Problems) -> anyhow::Result<Outcome> {
    let (given, named) = names::split(&args)?;
    let found = inputs::expand(&given);
    let mut output = named.clone().unwrap_or_default();
    let film = args.path.as_deref().map(|path| {
        Film::new(path, &args, |pictures| {
            if named.is_none() {
                output = names::made_up(&args, &given, &found, pictures);
            }
            output.clone()
        })
    });
    let film = film.transpose()?;
    if named.is_none() && film.is_none() {
        output = names::made_up(&args, &given, &found, 1);
    }
    names::check(&output, args.each)?;
    if Format::of(&output)? == Format::Jpeg && args.background == Some(Background::None) {
        let why = format!("{}: a JPEG has no transparent background: write a .png", output.display());
        return Err(UsageError(why).into());
    }
    if let (Some(Place::At(eye)), Some(Place::At(target))) = (args.eye, args.target) {
        Camera::look_at(eye, target, Projection::default()).map_err(|e| UsageError(e.to_string()))?;
    }
    let mut protected = Protected::of(&found);
    args.path.iter().for_each(|path| protected.add(path));
    let stems = if args.each { names::distinct_stems(&found.files) } else { Vec::new() };
    let pictures: Vec<PathBuf> = match &film {
        Some(film) => (0..film.frames.len() as u32).map(|number| film.pattern.file(number)).collect(),
        None if args.each => stems.iter().map(|stem| names::each_output(&output, stem)).collect(),
        None => vec![output.clone()],
    };
    if named.is_none() {
        pictures.iter().for_each(|picture| protected.add_made_up(picture));
    }
    if let (Some(Target::File(json)), Some(_)) = (&args.json, args.ortho)
        && [Format::of(&output)?.world_extension(), "prj"].iter().any(|e| *json == output.with_extension(e))
    {
        let why =
            format!("--json {}: refused: it is written beside the map: give another name", json.display());
        return Err(UsageError(why).into());
    }
    let named_so = |path: &PathBuf| ("-o", path.clone());
    check_targets(&protected, pictures.iter().map(named_so), args.json.iter().map(|to| ("--json", to)))?;
    let options = GpuOptions {
        device: args.device,
        validate: args.validate,
        cache: args.cache().map(|cache| cache.folder().to_owned()),
        ..Default::default()
    };
    let gpu = Gpu::new(&options).map_err(|e| match e {
        GpuError::NoSuchDevice { .. } => UsageError(e.to_string()).into(),
        e => anyhow::Error::from(e),
    })?;
    let options = LoadOptions {
        surface: args.surface,
        cell: args.cell.0,
        placement: args.placement.options(),
        rgb_bits: args.rgb_bits.as_ref().map(|b| if b == "8" { 8 } else { 16 }),
        asked: Asked { selection: args.selection.selection(), ..args.visibility(false).asked() },
        budget: Budget {
            host_bytes: args.host_memory,
            // Pages of the pool do not fill up to the last byte.
            device_bytes: args.device_budget(&gpu) - args.device_budget(&gpu) / 8,
        },
        cache: args.cache(),
        quiet: args.quiet,
    };
    if let Some(size) = args.size {
        check_size(&gpu, size).map_err(|e| UsageError(e.to_string()))?;
    }

    problems.look_at(&found);
    let opened = match args.demo {
        true => load::demo(args.color.0, &options, problems).map(Data::Whole),
        false if args.each => {
            let drawn = each(&gpu, (&found, &pictures), &args, &options, &protected, problems);
            finish(problems, &args);
            write_json(&args, drawn?, &protected)?;
            return outcome(&gpu, &args, problems);
        }
        false => load::open(&found.files, &options, problems)
            .and_then(|opening| Data::of(opening, None, (&args, &output), &options, problems)),
    };
    say(problems, &args);
    let work =
        Work { args: &args, output: &output, film: film.as_ref(), protected: &protected, legend: None };
    let drawn = opened.map_err(usage_of_load).and_then(|data| draw(&gpu, data, &work, problems));
    finish(problems, &args);
    write_json(&args, drawn?, &protected)?;
    outcome(&gpu, &args, problems)
}

fn outcome(gpu: &Gpu, args: &Args, problems: &Problems) -> anyhow::Result<Outcome> {
    anyhow::ensure!(gpu.messages().is_empty() || !args.validate, "the validation layers reported errors");
    Ok(if args.strict && problems.failed { Outcome::Incomplete } else { Outcome::Done })
}

/// One picture a file, all with the same cells and in the same colours. What is wrong with one of them does not stop the
/// others. Gives what those took that were drawn while data streams.
fn each(
    gpu: &Gpu,
    (found, pictures): (&Inputs, &[PathBuf]),
    args: &Args,
    options: &LoadOptions,
    protected: &Protected,
    problems: &mut Problems,
) -> anyhow::Result<Vec<Drawn>> {
    // What is to be said is said file by file.
    let all = match load::open(&found.files, options, &mut Problems::default()) {
        Ok(opening) => Some(opening.about),
        Err(LoadError::Nothing(_)) => None,
        Err(error) => return Err(usage_of_load(error)),
    };
    let placement = PlacementOptions { known: all.as_ref().map(About::world), ..options.placement.clone() };
    let cell = all.as_ref().map_or(options.cell, |all| Some(all.cell.into()));
    let options = LoadOptions { cell, placement, ..options.clone() };
    let (mut drawn, mut is_drawn, mut usage) = (Vec::new(), false, None);
    for (path, output) in found.files.iter().zip(pictures) {
        let said = problems.said();
        let work = Work { args, output, film: None, protected, legend: all.as_ref() };
        let data = load::open(std::slice::from_ref(path), &options, problems)
            .and_then(|opening| Data::of(opening, all.as_ref(), (args, output), &options, problems))
            .map_err(usage_of_load);
        match data.and_then(|data| draw(gpu, data, &work, problems)) {
            Ok(of_file) => {
                drawn.extend(of_file);
                is_drawn = true;
            }
            // Why nothing is left has been said.
            Err(error) if error.is::<LoadError>() && problems.said() > said => problems.lost(path),
            Err(error) => {
                problems.error(format!("{}: {error}", path.display()));
                usage = usage.or(error.downcast::<UsageError>().ok());
            }
        }
        say(problems, args);
    }
    match usage {
        _ if is_drawn => Ok(drawn),
        Some(usage) => Err(usage.into()),
        None => anyhow::bail!("nothing could be drawn"),
    }
}

/// Prints what has come up so far.
fn say(problems: &mut Problems, args: &Args) {
    // A closed stderr is nothing to stop for.
    let _ = problems.print(!args.quiet, &mut std::io::stderr().lock());
}

/// Prints what has come up.
fn finish(problems: &mut Problems, args: &Args) {
    let _ = problems.finish(!args.quiet, &mut std::io::stderr().lock());
}
