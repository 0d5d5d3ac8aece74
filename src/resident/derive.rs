//! What the device derives from payloads: the passes, what each reads and writes, and what runs again when something has
//! changed.
//!
//! Passes are declared ([`PASSES`]). Those before the first that reads beyond its section follow from that section alone;
//! the others run again where a neighbour's columns have come, changed or gone, and only in the half blocks that lie within
//! their reach of it.

use super::pool::{Access, Pool};
use super::visibility::{ColumnData, Visibility};
use super::work::{Recording, Submitter, Work};
use crate::coords::SECTION_SIDE;
use crate::gpu::{
    BindingKind, Buffer, ComputePipeline, Gpu, GpuError, MemoryKind, Order, PipelineDesc, SyncPoint, shaders,
};
use crate::limits::LIMITS;
#[cfg(feature = "view")]
use crate::section::Surface;
use crate::shared::passes::{
    DERIVE_THREADS, HALF_BLOCK_EAST, HALF_BLOCK_NORTH, ID_ALL, ID_BRIDGE, ID_WIDE, LONGEST_BRIDGE,
};
use bytemuck::{Pod, Zeroable};
use std::collections::{BTreeMap, HashMap, VecDeque};

const _: () = assert!(LIMITS.submit_sections * size_of::<Job>() <= LIMITS.constant_bytes as usize);

/// Threads in a workgroup of the passes that take half blocks.
const GROUP_THREADS: u32 = DERIVE_THREADS;
/// Columns of a half block, a thread's: east, north.
const HALF_BLOCK: [u32; 2] = [HALF_BLOCK_EAST, HALF_BLOCK_NORTH];
/// Half blocks of a section: east, north.
const HALF_BLOCKS: [u32; 2] = [SECTION_SIDE / HALF_BLOCK[0], SECTION_SIDE / HALF_BLOCK[1]];
// Bridges lead no farther into a section than a row of half blocks.
const _: () = assert!(LONGEST_BRIDGE <= HALF_BLOCK[0] && LONGEST_BRIDGE <= HALF_BLOCK[1]);

/// What passes read and write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Plane {
    /// What was uploaded.
    Runs,
    /// Lists' places, and lowest points of columns.
    Lowest,
    /// Lists of blocks, and their spans.
    Spans,
    /// Mean heights of what is solid.
    Means,
    /// Which columns hold a visible run.
    Measured,
    /// Level 0 of the pyramid, and what columns show.
    Columns,
    /// What spans are joined with.
    Joins,
    /// Corners of columns.
    Corners,
    /// Levels 1 and 2.
    LowerLevels,
    /// Levels 3 to 8.
    UpperLevels,
}

/// What one thread, or one workgroup, of a pass takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Grain {
    /// A thread a half block.
    HalfBlock,
    /// A thread a column.
    Column,
    /// A workgroup a section.
    Section,
}

/// Which sections a pass runs for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Of {
    /// Those of columns.
    Columns,
    /// Those of stacks.
    Stacks,
    /// Those in which anything may float.
    Floating,
    /// Those of smooth surfaces.
    Smooth,
    /// All.
    Both,
}

/// A derived pass, as it is declared.
struct PassDeclaration {
    name: &'static str,
    by_address: &'static [u32],
    by_buffer: &'static [u32],
    /// Columns beyond its section that what it writes follows from.
    reach: u32,
    reads: &'static [Plane],
    writes: &'static [Plane],
    grain: Grain,
    of: Of,
}

/// Derived passes, in the order in which they run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
enum Pass {
    Tops,
    StackTops,
    Floaters,
    Means,
    Bridge,
    Fill,
    Joins,
    Corners,
    Pyramid,
}

/// Where nothing is bridged, the first pass writes the lower levels too.
const PASSES: [PassDeclaration; 9] = [
    PassDeclaration {
        name: "tops",
        by_address: shaders::TOPS,
        by_buffer: shaders::TOPS_SSBO,
        reach: 0,
        reads: &[Plane::Runs],
        writes: &[Plane::Measured, Plane::Columns, Plane::LowerLevels],
        grain: Grain::HalfBlock,
        of: Of::Columns,
    },
    PassDeclaration {
        name: "stack tops",
        by_address: shaders::STACK_TOPS,
        by_buffer: shaders::STACK_TOPS_SSBO,
        reach: 0,
        reads: &[Plane::Runs],
        writes: &[Plane::Measured, Plane::Columns, Plane::LowerLevels, Plane::Lowest],
        grain: Grain::HalfBlock,
        of: Of::Stacks,
    },
    PassDeclaration {
        name: "floaters",
        by_address: shaders::FLOATERS,
        by_buffer: shaders::FLOATERS_SSBO,
        reach: 0,
        reads: &[Plane::Runs, Plane::Lowest],
        writes: &[Plane::Measured, Plane::Columns, Plane::LowerLevels, Plane::Spans],
        grain: Grain::HalfBlock,
        of: Of::Floating,
    },
    PassDeclaration {
        name: "means",
        by_address: shaders::MEANS,
        by_buffer: shaders::MEANS_SSBO,
        reach: 0,
        reads: &[Plane::Lowest, Plane::Spans, Plane::Measured, Plane::Columns],
        writes: &[Plane::Means],
        grain: Grain::Section,
        of: Of::Floating,
    },
    PassDeclaration {
        name: "bridge",
        by_address: shaders::BRIDGE,
        by_buffer: shaders::BRIDGE_SSBO,
        reach: LONGEST_BRIDGE,
        reads: &[Plane::Lowest, Plane::Spans, Plane::Measured, Plane::Columns],
        writes: &[Plane::Spans, Plane::Columns, Plane::LowerLevels],
        grain: Grain::HalfBlock,
        of: Of::Both,
    },
    PassDeclaration {
        name: "fill",
        by_address: shaders::FILL,
        by_buffer: shaders::FILL_SSBO,
        reach: 0,
        reads: &[Plane::Lowest, Plane::Spans, Plane::Means, Plane::Measured, Plane::Columns],
        writes: &[Plane::Spans, Plane::Columns, Plane::LowerLevels],
        grain: Grain::HalfBlock,
        of: Of::Floating,
    },
    PassDeclaration {
        name: "joins",
        by_address: shaders::JOINS,
        by_buffer: shaders::JOINS_SSBO,
        reach: 1,
        reads: &[Plane::Lowest, Plane::Spans],
        writes: &[Plane::Spans, Plane::Joins],
        grain: Grain::Column,
        of: Of::Smooth,
    },
    PassDeclaration {
        name: "corners",
        by_address: shaders::CORNERS,
        by_buffer: shaders::CORNERS_SSBO,
        // A column beside those that are bridged.
        reach: LONGEST_BRIDGE + 1,
        reads: &[Plane::Lowest, Plane::Spans, Plane::Columns, Plane::Joins],
        writes: &[Plane::Spans, Plane::Corners, Plane::LowerLevels],
        grain: Grain::HalfBlock,
        of: Of::Smooth,
    },
    PassDeclaration {
        name: "pyramid",
        by_address: shaders::PYRAMID,
        by_buffer: shaders::PYRAMID_SSBO,
        reach: 0,
        reads: &[Plane::LowerLevels],
        writes: &[Plane::UpperLevels],
        grain: Grain::Section,
        of: Of::Both,
    },
];

/// Specialization constants of a pass: wide heights, every run is visible, bridges follow.
type Variant = [bool; 3];

impl Pass {
    const ALL: [Pass; 9] = [
        Pass::Tops,
        Pass::StackTops,
        Pass::Floaters,
        Pass::Means,
        Pass::Bridge,
        Pass::Fill,
        Pass::Joins,
        Pass::Corners,
        Pass::Pyramid,
    ];

    fn declared(self) -> &'static PassDeclaration {
        &PASSES[self as usize]
    }

    /// The passes that run with or without bridges, and with or without smooth surfaces: those that follow from a section
    /// alone, and those from each on that reads its neighbours.
    fn phases(bridge: bool, smooth: bool) -> Vec<Vec<Pass>> {
        // Holes are filled where they are bridged.
        let runs = |pass: &Pass| match pass {
            Pass::Means | Pass::Bridge | Pass::Fill => bridge,
            Pass::Joins | Pass::Corners => smooth,
            _ => true,
        };
        let mut phases = vec![Vec::new()];
        for pass in Pass::ALL.into_iter().filter(runs) {
            if pass.declared().reach > 0 {
                phases.push(Vec::new());
            }
            phases.last_mut().expect("there is one").push(pass);
        }
        phases
    }

    /// Of a variant, what the pass differs by.
    fn variant(self, [wide, all, bridge]: Variant) -> Variant {
        match self {
            Pass::Tops | Pass::StackTops | Pass::Floaters => [wide, all, bridge],
            _ => [wide, false, false],
        }
    }

    /// Whether it reads or writes what `earlier` writes: then it waits for that.
    fn follows(self, earlier: Pass) -> bool {
        let touches =
            |plane: &Plane| self.declared().reads.contains(plane) || self.declared().writes.contains(plane);
        earlier.declared().writes.iter().any(touches)
    }

    fn desc(self, variant: Variant, access: Access) -> PipelineDesc {
        let declared = self.declared();
        let (words, push_bytes, bindings): (_, _, &[_]) = match access {
            Access::Address | Access::Texels => (declared.by_address, 16, &[]),
            Access::StorageBuffer => (declared.by_buffer, 0, &[BindingKind::Storage; 3]),
        };
        let constants = [ID_WIDE, ID_ALL, ID_BRIDGE].into_iter().zip(variant.map(u32::from)).collect();
        PipelineDesc { name: declared.name, words, constants, push_bytes, bindings }
    }
}

/// Pipelines of the derived passes: those of usual sections, with or without bridges, and all others. Whoever holds them
/// makes uploads quick.
#[cfg(feature = "view")]
pub fn pipeline_descs(access: Access, surface: Surface, bridge: bool) -> [Vec<PipelineDesc>; 2] {
    let all = (0..8u8).map(|bits| [0, 1, 2].map(|bit| bits >> bit & 1 == 1)).flat_map(|variant| {
        let passes = Pass::ALL.into_iter().filter(move |pass| pass.variant(variant) == variant);
        passes.map(move |pass| (pass, variant))
    });
    let is_usual = |&(pass, [wide, all, bridged]): &(Pass, Variant)| {
        !wide
            && pass.variant([wide, all, bridge]) == [wide, all, bridged]
            && Pass::phases(bridge, surface == Surface::Smooth).concat().contains(&pass)
            && (surface.floats() || !matches!(pass.declared().of, Of::Stacks | Of::Floating))
    };
    let (usual, others): (Vec<_>, Vec<_>) = all.partition(is_usual);
    [usual, others].map(|part| part.into_iter().map(|(pass, variant)| pass.desc(variant, access)).collect())
}

/// Of a section and its eight neighbours (row by row from the south-west), those whose columns have come, changed or
/// gone: a bit each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Changed(u16);

impl Changed {
    const OWN: u16 = 1 << 4;
    /// The section itself.
    pub const ITSELF: Changed = Changed(Changed::OWN);

    /// The same without the section itself.
    pub fn of_neighbours(self) -> Changed {
        Changed(self.0 & !Changed::OWN)
    }

    /// Whether nothing has.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// One more.
    pub fn insert(&mut self, neighbour: usize) {
        self.0 |= 1 << neighbour;
    }

    fn has(self, east: i32, north: i32) -> bool {
        self.0 >> ((north + 1) * 3 + east + 1) & 1 != 0
    }

    /// The half blocks that follow from them up to `reach` columns on, as rectangles that do not overlap: first half block and
    /// how many, each east and north.
    fn areas(self, reach: u32) -> Vec<[[u32; 2]; 2]> {
        let [width, height] = HALF_BLOCKS;
        let [across, up] = HALF_BLOCK.map(|columns| reach.div_ceil(columns));
        if self.0 & Self::OWN != 0 {
            return vec![[[0, 0], [width, height]]];
        }
        let mut areas = Vec::new();
        let (west, east) = (self.has(-1, 0), self.has(1, 0));
        for (is_near, x) in [(west, 0), (east, width - across)] {
            if is_near {
                areas.push([[x, 0], [across, height]]);
            }
        }
        for (north, y) in [(-1, 0), (1, height - up)] {
            if self.has(0, north) {
                let [first, last] = [west, east].map(|is_near| if is_near { across } else { 0 });
                areas.push([[first, y], [width - first - last, up]]);
                continue;
            }
            for (side, is_near, x) in [(-1, west, 0), (1, east, width - across)] {
                if self.has(side, north) && !is_near {
                    areas.push([[x, y], [across, up]]);
                }
            }
        }
        areas
    }
}

/// A version of a section that is to be derived, or derived again.
#[derive(Clone, Copy, Debug)]
pub struct Task {
    /// Where what was uploaded lies, and where its counts and further runs start, words.
    pub section: [u32; 4],
    /// What is derived of it and of its neighbours: place (0: not there), base, 1 for wide codes and 2 where things may
    /// float; its own is the fifth.
    pub near: [[u32; 4]; 9],
    /// Height steps a cell beyond which a gap is an edge.
    pub steepest: u32,
    /// Height steps within which runs are as high as each other, and one is shown whose class tells more; 0: none is.
    pub tie: u32,
    /// Of stacks: log2 height steps of a slice, those that what floats reaches down below its points, in how many half
    /// blocks anything may, and how far around is told what floats.
    pub stacks: Option<[u32; 4]>,
    /// Of smooth surfaces: height steps by which what hangs together rises from a column to the next at most, the first
    /// word of the corners, and words from a span to what it is joined with, 0: nothing may float.
    pub smooth: Option<[u32; 3]>,
    /// Codes take 32 bits.
    pub wide: bool,
    /// Every run is visible.
    pub all: bool,
    /// What has changed.
    pub changed: Changed,
}

/// Mirrors `Job` in `shaders/derive.glsl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Job {
    section: [u32; 4],
    near: [[u32; 4]; 9],
    steepest: u32,
    /// First half block, and how many, east in the lower half of the word and north in the upper.
    first: u32,
    area: u32,
    tie: u32,
    slice: u32,
    thickness: u32,
    lists: u32,
    jump: u32,
    corners: u32,
    reach: u32,
    joins: u32,
    spare: u32,
}

impl Task {
    fn job(&self, [first, area]: [[u32; 2]; 2]) -> Job {
        let word = |[east, north]: [u32; 2]| east | north << 16;
        let Task { section, near, steepest, tie, .. } = *self;
        let [slice, thickness, lists, reach] = self.stacks.unwrap_or_default();
        let [jump, corners, joins] = self.smooth.unwrap_or_default();
        Job {
            section,
            near,
            steepest,
            first: word(first),
            area: word(area),
            tie,
            slice,
            thickness,
            lists,
            jump,
            corners,
            reach,
            joins,
            spare: 0,
        }
    }

    /// Whether it takes a pass.
    fn takes(&self, pass: Pass) -> bool {
        match pass.declared().of {
            Of::Columns => self.stacks.is_none(),
            Of::Stacks => self.stacks.is_some(),
            Of::Floating => self.stacks.is_some_and(|[_, _, lists, _]| lists > 0),
            Of::Smooth => self.smooth.is_some(),
            Of::Both => true,
        }
    }

    /// Its jobs in a pass that it takes, by the workgroups that each takes.
    fn jobs(&self, pass: Pass) -> Vec<(u32, Job)> {
        let grain = pass.declared().grain;
        match grain {
            Grain::Section => vec![(1, self.job([[0; 2]; 2]))],
            Grain::HalfBlock | Grain::Column => {
                // What reads no neighbour follows from bridges, at least.
                let reach = pass.declared().reach.max(LONGEST_BRIDGE);
                let of_area = |area: [[u32; 2]; 2]| {
                    let [_, [width, height]] = area;
                    let threads = if grain == Grain::Column { HALF_BLOCK[0] * HALF_BLOCK[1] } else { 1 };
                    ((width * height * threads).div_ceil(GROUP_THREADS), self.job(area))
                };
                self.changed.areas(reach).into_iter().map(of_area).collect()
            }
        }
    }
}

/// Mirrors `Derive` in `shaders/derive.glsl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Parameters {
    visible: [u32; 8],
    hidden_flags: u32,
    bridge: u32,
    values: u32,
}

impl Parameters {
    fn of(visibility: &Visibility, column_data: ColumnData) -> Parameters {
        Parameters {
            visible: visibility.classes.0,
            hidden_flags: visibility.hidden_flags.bits().into(),
            bridge: visibility.bridge.min(LONGEST_BRIDGE),
            values: (column_data == ColumnData::Values).into(),
        }
    }
}

/// Runs derived passes.
pub struct Derive {
    gpu: Gpu,
    /// Made when first used.
    pipelines: HashMap<(Pass, Variant), ComputePipeline>,
    /// What derived passes of submits read, oldest first, to be used again.
    constants: VecDeque<(SyncPoint, Buffer)>,
    /// And those of the submit that is being recorded.
    recorded: Vec<Buffer>,
    /// Such buffers that were made.
    made: u64,
}

/// What one call of [`Derive::run`] has in common.
struct Run<'a> {
    pool: &'a Pool,
    bridge: bool,
    parameters: Buffer,
}

impl Derive {
    /// Nothing is made yet.
    pub fn new(gpu: &Gpu) -> Derive {
        Derive {
            gpu: gpu.clone(),
            pipelines: HashMap::new(),
            constants: VecDeque::new(),
            recorded: Vec::new(),
            made: 0,
        }
    }

    /// Buffers that were made for what passes read: few, since they serve again.
    pub fn buffers_made(&self) -> u64 {
        self.made
    }

    /// Submits the passes: those that follow from a section alone for `own`, the others for `all`; without bridges and smooth
    /// surfaces there are no others. `copied`: ends of the copies that they read. Nothing runs for long: a frame is never far behind.
    /// Gives how many sections were derived.
    pub fn run(
        &mut self,
        submitter: &mut Submitter,
        work: Work,
        pool: &Pool,
        (visibility, column_data): (&Visibility, ColumnData),
        [own, all]: [&[Task]; 2],
        copied: &[SyncPoint],
    ) -> Result<u64, GpuError> {
        // The first pass takes whole sections.
        debug_assert!(own.iter().all(|task| task.changed == Changed::ITSELF));
        let bridge = visibility.bridge > 0;
        let smooth = own.iter().chain(all).any(|task| task.smooth.is_some());
        // Otherwise nothing follows from what neighbours hold.
        let near = bridge || smooth;
        let all = if near { all } else { &[] };
        if own.is_empty() && all.is_empty() {
            return Ok(0);
        }
        let parameters = Parameters::of(visibility, column_data);
        let parameters = self.constant(submitter.order, bytemuck::bytes_of(&parameters))?;
        let run = Run { pool, bridge, parameters };
        let mut after = copied.to_vec();
        if pool.access() == Access::StorageBuffer {
            // Validation takes a bound buffer as touched all over.
            after.extend(submitter.submits.last_copy);
        }
        let mut built = None;
        let tasks = std::iter::once(own).chain(std::iter::repeat(all));
        for (passes, tasks) in Pass::phases(bridge, smooth).iter().zip(tasks) {
            for tasks in tasks.chunks(LIMITS.submit_sections) {
                let taken = |pass: &&Pass| tasks.iter().any(|task| task.takes(**pass));
                let passes: Vec<Pass> = passes.iter().filter(taken).copied().collect();
                let names: Vec<_> = passes.iter().map(|pass| pass.declared().name).collect();
                let commands = submitter.order.begin_build(&names.join(", "), &after)?;
                let mut recording = submitter.submits.start(work, commands)?;
                for (k, &pass) in passes.iter().enumerate() {
                    if passes[..k].iter().any(|&earlier| pass.follows(earlier)) {
                        submitter.order.next_pass(&mut recording.commands);
                    }
                    self.record(submitter.order, &mut recording, &run, pass, tasks)?;
                }
                let point = submitter.submits.submit(submitter.order, recording)?;
                self.constants.extend(self.recorded.drain(..).map(|buffer| (point, buffer)));
                built = Some(point);
            }
            if built.is_some() {
                // What follows on this submitter comes after it.
                after.clear();
            }
        }
        // All of its submits read them.
        self.constants.extend(built.map(|point| (point, run.parameters)));
        let too_many = self.constants.len().saturating_sub(LIMITS.spare_constants);
        self.constants.drain(..too_many);
        Ok(if near { all.len() } else { own.len() } as u64)
    }

    /// Dispatches one pass, each variant for the sections that want it.
    fn record(
        &mut self,
        order: &mut Order,
        recording: &mut Recording,
        run: &Run,
        pass: Pass,
        tasks: &[Task],
    ) -> Result<(), GpuError> {
        let variant = |task: &Task| pass.variant([task.wide, task.all, run.bridge]);
        let mut dispatches: BTreeMap<(Variant, u32), Vec<Job>> = BTreeMap::new();
        for task in tasks.iter().filter(|task| task.takes(pass)) {
            for (groups, job) in task.jobs(pass) {
                dispatches.entry((variant(task), groups)).or_default().push(job);
            }
        }
        let dispatches = dispatches.iter().flat_map(|((variant, groups), jobs)| {
            jobs.chunks(LIMITS.submit_sections).map(move |jobs| (*variant, *groups, jobs))
        });
        for (k, (variant, groups, jobs)) in dispatches.enumerate() {
            if k > 0 && run.pool.access() == Access::StorageBuffer {
                // Validation takes a bound buffer as touched all over.
                order.next_pass(&mut recording.commands);
            }
            let groups = match pass.declared().grain {
                Grain::HalfBlock | Grain::Column => [groups, jobs.len() as u32, 1],
                Grain::Section => [jobs.len() as u32, 1, 1],
            };
            let pipeline = self.pipeline(pass, variant, run.pool.access())?;
            self.dispatch(order, recording, run, &pipeline, jobs, groups)?;
        }
        Ok(())
    }

    fn pipeline(
        &mut self,
        pass: Pass,
        variant: Variant,
        access: Access,
    ) -> Result<ComputePipeline, GpuError> {
        if let Some(known) = self.pipelines.get(&(pass, variant)) {
            return Ok(known.clone());
        }
        let pipeline = pass.desc(variant, access).make(&self.gpu)?;
        self.pipelines.insert((pass, variant), pipeline.clone());
        Ok(pipeline)
    }

    fn dispatch(
        &mut self,
        order: &mut Order,
        recording: &mut Recording,
        run: &Run,
        pipeline: &ComputePipeline,
        jobs: &[Job],
        groups: [u32; 3],
    ) -> Result<(), GpuError> {
        let jobs = self.constant(order, bytemuck::cast_slice(jobs))?;
        self.recorded.push(jobs.clone());
        let commands = &mut recording.commands;
        commands.bind(pipeline);
        match run.pool.access() {
            Access::Address | Access::Texels => {
                commands.push(bytemuck::cast_slice(&[jobs.address(), run.parameters.address()]));
                run.pool.buffers().for_each(|b| commands.keep(b.clone()));
                commands.keep(jobs);
                commands.keep(run.parameters.clone());
            }
            Access::StorageBuffer => {
                let page = run.pool.buffers().next().expect("a section is resident");
                commands.bind_buffers(&pipeline.binding(&[page, &jobs, &run.parameters])?);
            }
        }
        commands.dispatch(groups);
        Ok(())
    }

    /// A buffer that begins with `bytes`, of which there are no more than `LIMITS.constant_bytes`: one that earlier
    /// passes are known to be done with, if there is one.
    fn constant(&mut self, order: &mut Order, bytes: &[u8]) -> Result<Buffer, GpuError> {
        let is_free = match self.constants.front() {
            Some((point, _)) => order.is_known_done(*point),
            None => false,
        };
        let free = if is_free { self.constants.pop_front() } else { None };
        let buffer = match free {
            Some((_, buffer)) => buffer,
            None => {
                self.made += 1;
                let (name, bytes) = ("what derived passes read", LIMITS.constant_bytes);
                Buffer::new(&self.gpu, name, MemoryKind::Upload, bytes)?
            }
        };
        buffer.write(0, bytes);
        Ok(buffer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::layout::{assert_in, members};

    #[test]
    fn shaders_see_jobs_and_parameters_as_they_are_written() {
        let parameters = members!(Parameters { visible, hidden_flags, bridge, values });
        for PassDeclaration { name, by_address, by_buffer, .. } in &PASSES {
            let pass = [(*name, *by_address), (*name, *by_buffer)];
            assert_in(
                &pass,
                &members!(Job {
                    section,
                    near,
                    steepest,
                    first,
                    area,
                    tie,
                    slice,
                    thickness,
                    lists,
                    jump,
                    corners,
                    reach,
                    joins,
                    spare
                }),
            );
            // Others follow from what the mask has left.
            if matches!(*name, "tops" | "stack tops" | "floaters" | "bridge") {
                assert_in(&pass, &parameters);
            }
        }
    }

    #[test]
    fn passes_run_in_an_order_in_which_each_finds_what_it_reads() {
        for [bridge, smooth] in [[false, false], [true, false], [false, true], [true, true]] {
            let phases = Pass::phases(bridge, smooth);
            assert!(phases[0].iter().all(|pass| pass.declared().reach == 0));
            assert!(phases.iter().all(|phase| phase[1..].iter().all(|pass| pass.declared().reach == 0)));
            assert_eq!(phases.len(), 1 + usize::from(bridge) + 2 * usize::from(smooth));
            let all = phases.concat();
            for (k, pass) in all.iter().enumerate() {
                let is_written = |plane: &Plane| {
                    *plane == Plane::Runs || all[..k].iter().any(|p| p.declared().writes.contains(plane))
                };
                assert!(pass.declared().reads.iter().all(is_written), "{pass:?}");
                assert!(k == 0 || all[..k].iter().any(|earlier| pass.follows(*earlier)), "{pass:?}");
            }
            assert_eq!(all.contains(&Pass::Bridge), bridge);
            assert_eq!(all.contains(&Pass::Corners), smooth);
        }
    }

    /// Half blocks within the reach of what has changed, one by one.
    #[test]
    fn areas_are_what_lies_within_reach_of_what_has_changed() {
        let side = SECTION_SIDE as i32;
        let cases =
            [LONGEST_BRIDGE, LONGEST_BRIDGE + 1].map(|reach| (0..1u16 << 9).map(move |bits| (reach, bits)));
        for (reach, bits) in cases.into_iter().flatten() {
            let mut times = HashMap::new();
            for [first, size] in Changed(bits).areas(reach) {
                for y in first[1]..first[1] + size[1] {
                    for x in first[0]..first[0] + size[0] {
                        *times.entry([x, y]).or_insert(0) += 1;
                    }
                }
            }
            for y in 0..HALF_BLOCKS[1] {
                for x in 0..HALF_BLOCKS[0] {
                    let reach = reach as i32;
                    let low = [(x * HALF_BLOCK[0]) as i32 - reach, (y * HALF_BLOCK[1]) as i32 - reach];
                    let high = [
                        ((x + 1) * HALF_BLOCK[0]) as i32 - 1 + reach,
                        ((y + 1) * HALF_BLOCK[1]) as i32 - 1 + reach,
                    ];
                    // Sections that these columns lie in.
                    let sections =
                        [0, 1].map(|axis| low[axis].div_euclid(side)..=high[axis].div_euclid(side));
                    let follows = sections[1]
                        .clone()
                        .any(|north| sections[0].clone().any(|east| Changed(bits).has(east, north)));
                    assert_eq!(
                        times.get(&[x, y]).copied().unwrap_or(0),
                        i32::from(follows),
                        "{bits:b} {x} {y}"
                    );
                }
            }
        }
    }
}
