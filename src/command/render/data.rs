//! What is drawn, and how it comes onto the device: all of it at once, or what an image needs.

use super::args::{Args, Wait};
use crate::coords::{Grid, SectionKey};
use crate::gpu::{Gpu, Order};
use crate::ingest::bins::Core;
use crate::ingest::builds::Made;
use crate::ingest::input::OpenInput;
use crate::limits::LIMITS;
use crate::load::{self, About, LoadError, LoadOptions, Loaded, Opening};
use crate::problems::Problems;
use crate::resident::cut::{Shown, Sight};
use crate::resident::live::{Live, Status};
use crate::resident::pool::Access;
use crate::resident::scene::Scene;
use crate::resident::visibility::why_hidden;
use crate::section::slot::slot_bytes;
use crate::section::{Columns, Payload, PayloadKind};
use crate::source::Reading;
use std::path::Path;
use std::time::Duration;

/// What is drawn.
pub(super) enum Data {
    /// All of it in memory, at the finest level.
    Whole(Loaded),
    /// What pictures need of it is read when they need it.
    Live(Opening),
}

impl Data {
    /// `legend`: what colours are chosen by, where it is not the data alone.
    pub(super) fn of(
        opening: Opening,
        legend: Option<&About>,
        (args, output): (&Args, &Path),
        options: &LoadOptions,
        problems: &mut Problems,
    ) -> Result<Data, LoadError> {
        let legend = legend.unwrap_or(&opening.about);
        let (mode, summary) = (args.color.0.unwrap_or(legend.color), legend.summary.clone());
        let opening = opening.colored(mode, &summary, problems);
        // Exact pictures are made of the finest cells, all of them; the plain traversal knows no others.
        let exact = args.is_exact(output);
        let whole = args.plain || args.detail.is_none() && exact && args.wait == Wait::Complete;
        match whole {
            true => load::read(opening, options, problems).map(Data::Whole),
            false => Ok(Data::Live(opening)),
        }
    }

    /// Its grid, what is known of it, and the rest.
    pub(super) fn into_parts(self) -> (Grid, About, Content) {
        match self {
            Data::Whole(Loaded { grid, about, sections, points, binned }) => {
                (grid, about, Content::Whole(sections, [points, binned]))
            }
            Data::Live(Opening { inputs, grid, core, about, reading }) => {
                (grid, about, Content::Live(inputs, core, reading))
            }
        }
    }
}

/// What scenes are filled from.
pub(super) enum Content {
    /// Sections, how many points were read, and how many of them are in sections.
    Whole(Vec<(SectionKey, Columns)>, [u64; 2]),
    /// Files to be read.
    Live(Vec<OpenInput>, Core, Reading),
}

/// A scene, and what is streamed into it.
pub(super) struct Filled {
    /// None where all of it is resident. It goes before the scene: its threads read for that.
    pub(super) live: Option<Live>,
    pub(super) scene: Scene,
    /// Points in all files.
    pub(super) points: u64,
    /// Those that are in sections which are resident from the start.
    selected: u64,
    /// Sections that are resident from the start.
    pub(super) sections: usize,
}

impl Filled {
    /// Points that take part, and whether that is an estimate.
    pub(super) fn taking_part(&self) -> (u64, bool) {
        self.live
            .as_ref()
            .map(Live::kinds)
            .map_or((self.selected, false), |kinds| (kinds.all(), !kinds.is_exact))
    }

    /// Uploads what is in memory, or starts to read what is not. `exact`: pixels are specified
    /// exactly; `keeps_copies`: more than one image is drawn.
    pub(super) fn new(
        gpu: &Gpu,
        args: &Args,
        content: Content,
        grid: Grid,
        [exact, keeps_copies]: [bool; 2],
    ) -> anyhow::Result<Filled> {
        let pool_bytes = args.device_budget(gpu);
        let access = Access::best(
            gpu,
            match &content {
                Content::Whole(sections, _) => sections
                    .iter()
                    .map(|(_, columns)| slot_bytes(columns.layout_at_most().derived_bytes()))
                    .sum(),
                Content::Live(..) => args.surface.derived_of(pool_bytes),
            },
        );
        let visibility = args.visibility(exact);
        let mut scene = Scene::new(gpu, |order: Order| order, access, pool_bytes, visibility, grid)?;
        match content {
            Content::Whole(sections, [points, selected]) => {
                let count = sections.len();
                upload(&mut scene, sections)?;
                if let Some(why) = why_hidden(&scene.kinds(), &scene.visibility()) {
                    anyhow::bail!("nothing to draw: {why}");
                }
                Ok(Filled { scene, live: None, points, selected, sections: count })
            }
            Content::Live(inputs, core, reading) => {
                let points = inputs.iter().map(|input| input.input.file.points()).sum();
                let host_bytes = args.host_memory;
                let made = Made { surface: args.surface, reading };
                let mut live = Live::new(inputs, made, grid, core, host_bytes, load::threads(), || ());
                if !keeps_copies {
                    live.keep_no_copies();
                }
                if let Some(cache) = args.cache() {
                    live.save_learned_to(cache);
                }
                Ok(Filled { scene, live: Some(live), points, selected: 0, sections: 0 })
            }
        }
    }
}

/// Cells of a sparse sample that all of the data is wide, from which on it is a picture of that.
const SAMPLED_CELLS: f64 = 16.0;
/// Points that are decoded, at most, for a first picture of data with a coarser sample.
const FIRST_POINTS: u64 = 8_000_000;

/// Whether there is something to see of data that is so many finest cells wide: all that its picture needs, or what stands in
/// for it. Data of a few chunks has a sample of a few cells, much larger than itself; it is soon read.
fn shows_something(live: &Live, scene: &Scene, width: f64) -> bool {
    let is_slab = |(_, from): &Shown| {
        let cells = width / f64::from(from.section.level).exp2();
        from.kind == PayloadKind::Sample && cells < SAMPLED_CELLS
    };
    let has_read = || live.try_status(scene).is_some_and(|now| now.progress.points_read >= FIRST_POINTS);
    live.has_sample() && !live.shown().is_empty() && (!live.shown().iter().any(is_slab) || has_read())
}

/// Reads and uploads what a picture needs, or until there is something to see of data that is so many finest cells wide.
pub(super) fn fill(
    live: &mut Live,
    scene: &mut Scene,
    sight: &Sight,
    args: &Args,
    (wait, width): (Wait, f64),
) -> anyhow::Result<Status> {
    let bar = load::bar(0, args.quiet, "reading {wide_bar} {human_pos}/{human_len} sections {eta}");
    loop {
        let tick = live.tick(scene, sight, LIMITS.fill_bytes)?;
        let enough = match wait {
            Wait::Complete => tick.complete,
            Wait::None => tick.complete || shows_something(live, scene, width),
        };
        if enough {
            if wait == Wait::Complete {
                live.evict_unseen(scene)?;
            }
            break;
        }
        if let Some(why) = live.failed() {
            anyhow::bail!(why);
        }
        if tick.stuck {
            let (host, device) = (args.host_memory, args.device_memory);
            return Err(LoadError::Budget { host, device }.into());
        }
        if !bar.is_hidden() {
            let status = live.status(scene);
            bar.set_length(status.wanted as u64);
            bar.set_position(status.ready as u64);
        }
        scene.flush()?;
        live.wait(Duration::from_millis(2));
    }
    bar.finish_and_clear();
    Ok(live.status(scene))
}

/// Packs on one thread while another copies; what is packed is freed.
fn upload(scene: &mut Scene, sections: Vec<(SectionKey, Columns)>) -> anyhow::Result<()> {
    let (send, receive) = crossbeam_channel::bounded::<(SectionKey, Payload)>(4);
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let work = std::sync::Mutex::new(sections.into_iter());
    std::thread::scope(|scope| {
        for _ in 0..threads {
            let (send, work) = (send.clone(), &work);
            scope.spawn(move || {
                loop {
                    let next = work.lock().unwrap_or_else(|e| e.into_inner()).next();
                    let Some((key, columns)) = next else { return };
                    // The receiver hangs up when the device fails: then there is nothing left to do.
                    if send.send((key, columns.pack())).is_err() {
                        return;
                    }
                }
            });
        }
        drop(send);
        for (key, packed) in receive {
            anyhow::ensure!(
                scene.upload(key, &packed)?,
                "the sections do not fit the device memory: give more with --device-memory, or a larger --cell"
            );
        }
        Ok(())
    })?;
    scene.settle()?;
    Ok(())
}
