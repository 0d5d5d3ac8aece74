//! Runs `lasray render`: checks the arguments, opens the device and the data, draws one image or one a file.

use super::args::Args;
use super::data::Data;
use super::draw::draw;
use super::film::Film;
use crate::command::outcome::{Outcome, UsageError, usage_of_load};
use crate::command::targets::check_targets;
use crate::gpu::{Gpu, GpuError, GpuOptions};
use crate::ingest::bins::Budget;
use crate::load::{self, LoadError, LoadOptions};
use crate::output::{self, Protected, Target};
use crate::problems::Problems;
use crate::render::camera::{Camera, Projection};
use crate::render::frame::check_size;
use crate::render::image::Format;
use crate::source::inputs::{self, Inputs};
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// Draws.
pub fn run(args: Args, problems: &mut Problems) -> anyhow::Result<Outcome> {
    check_output(&args.output, args.each)?;
    let film = args.path.as_deref().map(|path| Film::new(path, &args)).transpose()?;
    if let (Some(eye), Some(target)) = (args.eye, args.target) {
        Camera::look_at(eye, target, Projection::default()).map_err(|e| UsageError(e.to_string()))?;
    }
    let found = inputs::expand(&args.inputs);
    let mut protected = Protected::of(&found);
    args.path.iter().for_each(|path| protected.add(path));
    let pictures: Box<dyn Iterator<Item = PathBuf>> = match &film {
        Some(film) => Box::new((0..film.frames.len() as u32).map(|number| film.pattern.file(number))),
        None if args.each => Box::new(found.files.iter().map(|path| each_output(&args.output, path))),
        None => Box::new(std::iter::once(args.output.clone())),
    };
    if let (Some(Target::File(json)), Some(_)) = (&args.json, args.ortho)
        && ["pgw", "wld", "prj"].iter().any(|side| *json == args.output.with_extension(side))
    {
        let why =
            format!("--json {}: refused: it is written beside the map: give another name", json.display());
        return Err(UsageError(why).into());
    }
    check_targets(&protected, pictures.map(|path| ("-o", path)), args.json.iter().map(|to| ("--json", to)))?;
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
        cell: args.cell.0,
        placement: args.placement.options(),
        rgb_bits: args.rgb_bits.as_ref().map(|b| if b == "8" { 8 } else { 16 }),
        asked: args.visibility().asked(),
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
    if args.each {
        let drawn = each(&gpu, &found, &args, &options, &protected, problems);
        finish(problems, &args);
        drawn?;
    } else {
        let data = if args.demo {
            load::demo(&options, problems).map(Data::Whole)
        } else {
            Data::of(&found.files, &args, &options, problems)
        };
        say(problems, &args);
        let drawn = data
            .map_err(usage_of_load)
            .and_then(|d| draw(&gpu, d, &args, &args.output, film.as_ref(), &protected, problems));
        finish(problems, &args);
        drawn?;
    }
    anyhow::ensure!(gpu.messages().is_empty() || !args.validate, "the validation layers reported errors");
    Ok(if args.strict && problems.failed { Outcome::Incomplete } else { Outcome::Done })
}

/// One picture a file. What is wrong with one of them does not stop the others.
fn each(
    gpu: &Gpu,
    found: &Inputs,
    args: &Args,
    options: &LoadOptions,
    protected: &Protected,
    problems: &mut Problems,
) -> anyhow::Result<()> {
    let mut taken = HashSet::new();
    let (mut drawn, mut usage) = (false, None);
    for path in &found.files {
        let output = each_output(&args.output, path);
        if !taken.insert(output::one_name(&output)) {
            let (path, output) = (path.display(), output.display());
            problems.error(format!("{path}: not drawn into {output}: another input has that name"));
            continue;
        }
        let said = problems.said();
        let data = Data::of(std::slice::from_ref(path), args, options, problems).map_err(usage_of_load);
        match data.and_then(|data| draw(gpu, data, args, &output, None, protected, problems)) {
            Ok(()) => drawn = true,
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
        _ if drawn => Ok(()),
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

/// `{stem}` in `pattern` by the input's name without its extensions.
fn each_output(pattern: &Path, input: &Path) -> PathBuf {
    let name = input.file_name().unwrap_or_default().to_string_lossy();
    let lower = name.to_lowercase();
    let cut = [".copc.laz", ".laz", ".las"].iter().find(|e| lower.ends_with(**e)).map_or(0, |e| e.len());
    PathBuf::from(pattern.to_string_lossy().replace("{stem}", &name[..name.len() - cut]))
}

/// Finds out before the work whether its result can be written.
fn check_output(output: &Path, each: bool) -> anyhow::Result<()> {
    Format::of(output).map_err(|e| UsageError(e.to_string()))?;
    if each && !output.to_string_lossy().contains("{stem}") {
        return Err(UsageError("--each needs {stem} in the output's name: -o '{stem}.png'".to_owned()).into());
    }
    if !each && output.to_string_lossy().contains("{stem}") {
        return Err(UsageError("{stem} in the output's name goes with --each".to_owned()).into());
    }
    let folder = match output.parent() {
        Some(p) if !p.as_os_str().is_empty() && !p.to_string_lossy().contains("{stem}") => p,
        Some(p) if p.to_string_lossy().contains("{stem}") => return Ok(()),
        _ => Path::new("."),
    };
    let wrong = if output.is_dir() {
        "it is a folder".to_owned()
    } else if !folder.exists() {
        format!("the folder {} does not exist", folder.display())
    } else {
        match tempfile::tempfile_in(folder) {
            Ok(_) => return Ok(()),
            Err(error) => format!("{}: {error}", folder.display()),
        }
    };
    anyhow::bail!("{}: cannot be written: {wrong}", output.display())
}
