//! Where decoded points are gathered into sections, by several threads at once.
//!
//! A block of points is grouped by section first, so that each section is locked once a block; the result
//! does not depend on the order of blocks, threads or files. When the sections outgrow a budget, all of them
//! are coarsened by one power of two, which equals having binned at that size from the start.

pub use super::meaning::Meaning;
use super::selecting::Selector;
use crate::attribute::{Attributes, Channel, Record};
use crate::coords::{CellIndex, Grid, Height, Ordinary, SECTION_SIDE, SectionKey};
use crate::limits::LIMITS;
use crate::section::{Columns, Measure, Surface, column_index, device_bytes};
use crate::source::{PointBlock, Reading};
use std::collections::{HashMap, HashSet};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock, RwLockReadGuard, TryLockError};

/// Coarsenings that the grid's anchor allows for (it is a multiple of 2²⁴ cells).
const MOST_COARSENINGS: u32 = 16;

/// Sections far outside the rest that are still drawn; when there are more, all of them are noise.
const MOST_STRAYS: usize = 32;
/// Points far outside the rest that are kept until it is known how many sections they fill.
const MOST_STRAY_POINTS: usize = 1 << 16;

/// What bounds the sections' memory.
#[derive(Clone, Copy, Debug)]
pub struct Budget {
    /// Bytes of host memory while points arrive.
    pub host_bytes: u64,
    /// Bytes of device memory once they are resident.
    pub device_bytes: u64,
}

/// All sections while points arrive.
pub struct Bins {
    surface: Surface,
    reading: Reading,
    /// Read-locked while a block is binned; write-locked to coarsen.
    grid: RwLock<Grid>,
    sections: Mutex<HashMap<SectionKey, Shared>>,
    strays: Mutex<Strays>,
    /// What lies outside is a stray.
    core: Core,
    budget: Budget,
    host_bytes: AtomicU64,
    device_bytes: AtomicU64,
    outside: AtomicU64,
}

/// Points outside the core, kept aside: which of them are drawn must not depend on the cell size of the moment.
#[derive(Default)]
struct Strays {
    /// E, N; empty once there were more than [`MOST_STRAY_POINTS`].
    points: Vec<([f64; 2], Record)>,
    count: u64,
}

/// A section that several threads put points into.
pub type Shared = Arc<Mutex<Columns>>;

/// A section of a level of `grid` without points, whose records are to hold `channel`.
pub fn columns(surface: Surface, channel: &Channel, grid: &Grid, level: u8) -> Columns {
    Columns::new(surface, grid.stacking(level)).measuring(Measure::of(channel, grid, level))
}

/// Cells of the base grid, west-east and south-north, that the data is believed to lie in.
pub type Core = [std::ops::Range<i64>; 2];

/// Whether a place lies outside the core.
#[inline]
fn is_stray(grid: &Grid, [columns, rows]: &Core, [e, n]: [f64; 2]) -> bool {
    let [i, j] = [e, n].map(|v| v / grid.base_cell);
    i < columns.start as f64 || i >= columns.end as f64 || j < rows.start as f64 || j >= rows.end as f64
}

/// The finished sections.
pub struct Binned {
    /// The grid that they ended up on.
    pub grid: Grid,
    /// In key order.
    pub sections: Vec<(SectionKey, Columns)>,
    /// Points that no cell or height can hold, or so scattered and far away that they are not drawn.
    pub outside: u64,
}

/// A section locked by a thread that panicked is still whole: records are replaced one at a time.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Bins {
    /// Empty bins on `grid`, of columns as `surface` has them.
    pub fn new(surface: Surface, grid: Grid, core: Core, budget: Budget) -> Bins {
        Bins {
            surface,
            reading: Reading::default(),
            grid: RwLock::new(grid),
            sections: Mutex::default(),
            strays: Mutex::default(),
            core,
            budget,
            host_bytes: AtomicU64::new(0),
            device_bytes: AtomicU64::new(0),
            outside: AtomicU64::new(0),
        }
    }

    /// The same, of points as `reading` has them.
    pub fn with_reading(self, reading: Reading) -> Bins {
        Bins { reading, ..self }
    }

    /// Which points take part, and what their records hold.
    pub fn reading(&self) -> &Reading {
        &self.reading
    }

    fn read_grid(&self) -> RwLockReadGuard<'_, Grid> {
        self.grid.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn keep_stray(&self, at: [f64; 2], record: Record) {
        let mut strays = lock(&self.strays);
        strays.count += 1;
        if strays.count > MOST_STRAY_POINTS as u64 {
            strays.points = Vec::new();
        } else {
            strays.points.push((at, record));
        }
    }

    /// One without points.
    fn columns(&self, grid: &Grid) -> Columns {
        columns(self.surface, &self.reading.channel, grid, 0)
    }

    /// The section `key` of `grid`, made if need be.
    fn section(&self, key: SectionKey, grid: &Grid) -> Shared {
        let make = || Arc::new(Mutex::new(self.columns(grid)));
        Arc::clone(lock(&self.sections).entry(key).or_insert_with(make))
    }

    fn over_budget(&self) -> bool {
        self.host_bytes.load(Ordering::Relaxed) > self.budget.host_bytes
            || self.device_bytes.load(Ordering::Relaxed) > self.budget.device_bytes
    }

    /// Doubles the cell size until the sections fit, unless that is happening elsewhere.
    fn fit(&self) {
        while self.over_budget() {
            let coarsen = self.read_grid().coarsen;
            if coarsen == MOST_COARSENINGS {
                return;
            }
            self.coarsen(coarsen);
        }
    }

    /// Doubles the cell size if that has not happened since `coarsen` was seen and is still needed.
    fn coarsen(&self, coarsen: u32) {
        let mut grid = self.grid.write().unwrap_or_else(PoisonError::into_inner);
        if grid.coarsen != coarsen || !self.over_budget() || coarsen == MOST_COARSENINGS {
            return;
        }
        grid.coarsen += 1;
        grid.anchor = grid.anchor.map(|a| a >> 1);
        let mut sections = lock(&self.sections);
        let mut parents = HashMap::<SectionKey, Columns>::new();
        for (key, child) in sections.drain() {
            // Keys stay at level 0: the grid itself is coarser now.
            let parent = SectionKey { level: 0, ..key.parent() };
            let parent = parents.entry(parent).or_insert_with(|| self.columns(&grid));
            lock(&child).coarsen_into(key.i, key.j, parent);
        }
        let (mut host, mut device) = (0, 0);
        for (key, parent) in parents {
            host += parent.bytes() as u64;
            device += device_bytes(&parent.layout_at_most());
            sections.insert(key, Arc::new(Mutex::new(parent)));
        }
        self.host_bytes.store(host, Ordering::Relaxed);
        self.device_bytes.store(device, Ordering::Relaxed);
    }

    /// Ends the gathering; what it gives is the same whatever the order in which points came.
    /// `None` when even the coarsest cells do not fit the budget.
    pub fn finish(self) -> Option<Binned> {
        self.fit();
        if self.over_budget() {
            return None;
        }
        let grid = self.grid.into_inner().unwrap_or_else(PoisonError::into_inner);
        let strays = self.strays.into_inner().unwrap_or_else(PoisonError::into_inner);
        let sections = self.sections.into_inner().unwrap_or_else(PoisonError::into_inner);
        let mut sections: HashMap<_, _> = sections
            .into_iter()
            .map(|(key, shared)| {
                let mutex = Arc::into_inner(shared).expect("no thread bins any more");
                (key, mutex.into_inner().unwrap_or_else(PoisonError::into_inner))
            })
            .collect();
        let mut outside = self.outside.into_inner();
        // A few strays are drawn, in sections of their own or in others'; a cloud of them is noise.
        let cells: Vec<_> = strays.points.iter().filter_map(|(at, _)| grid.cell_of(at[0], at[1])).collect();
        let own: HashSet<_> =
            cells.iter().map(|&c| SectionKey::of(c)).filter(|key| !sections.contains_key(key)).collect();
        if own.len() > MOST_STRAYS || strays.points.len() as u64 != strays.count {
            outside += strays.count;
        } else {
            let side = SECTION_SIDE as i32 - 1;
            for (cell, (_, record)) in cells.into_iter().zip(strays.points) {
                let of_strays = || columns(self.surface, &self.reading.channel, &grid, 0);
                let of_cell = sections.entry(SectionKey::of(cell)).or_insert_with(of_strays);
                of_cell.add((cell.i & side) as u32, (cell.j & side) as u32, record);
            }
        }
        let mut sections: Vec<_> = sections.into_iter().collect();
        sections.iter_mut().for_each(|(_, columns)| columns.finish_measure());
        sections.sort_unstable_by_key(|(key, _)| *key);
        Some(Binned { grid, sections, outside })
    }
}

/// Points that are placed at a time.
const BATCH: usize = 128;

/// Consecutive points of a piece in the same section.
#[derive(Clone, Copy)]
struct Run {
    section: u32,
    first: u32,
    end: u32,
}

/// Bins blocks; one a thread, its buffers are reused.
#[derive(Default)]
pub struct Binner {
    /// Of each point of the piece.
    columns: Vec<u16>,
    heights: Vec<Height>,
    keys: Vec<SectionKey>,
    index_of: HashMap<SectionKey, u32>,
    runs: Vec<Run>,
    /// Start of each section's runs in `order`.
    starts: Vec<u32>,
    order: Vec<Run>,
    selector: Selector,
}

/// Record of point `i` of `block`.
#[inline]
fn record(meaning: &impl Meaning, block: &PointBlock, i: usize, height: Height) -> Record {
    Record::pack(Attributes {
        height,
        class: block.class[i],
        intensity: block.intensity[i],
        rgb: meaning.rgb(block, i),
        returns: block.returns[i],
        flags: block.flags[i],
    })
}

impl Binner {
    /// Puts those points of `block` that take part into their columns. O(points).
    pub fn bin(&mut self, bins: &Bins, meaning: &impl Meaning, block: &PointBlock) {
        let mut selector = std::mem::take(&mut self.selector);
        self.bin_selected(bins, meaning, selector.apply(&bins.reading, meaning, block));
        self.selector = selector;
    }

    fn bin_selected(&mut self, bins: &Bins, meaning: &impl Meaning, block: &PointBlock) {
        let mut first = 0;
        while first < block.len() {
            let grid = bins.read_grid();
            let stray = &mut |at, record| bins.keep_stray(at, record);
            let (next, outside) = self.place(&grid, &bins.core, meaning, block, first, stray);
            self.group();
            let grown = self.put(meaning, block, first, &|key| Some(bins.section(key, &grid)));
            bins.outside.fetch_add(outside, Ordering::Relaxed);
            bins.host_bytes.fetch_add(grown[0] as u64, Ordering::Relaxed);
            bins.device_bytes.fetch_add(grown[1] as u64, Ordering::Relaxed);
            // Coarser cells are counted again; only then, or what is new would be counted twice.
            drop(grid);
            first = next;
            bins.fit();
        }
    }

    /// Puts those points of `block` into their columns whose section (of `grid`, at level 0) `section` gives. Points
    /// outside `core` (cells of the base grid) are left out. Gives how many have no cell or height at all.
    pub fn bin_into(
        &mut self,
        grid: &Grid,
        core: &Core,
        meaning: &impl Meaning,
        block: &PointBlock,
        section: &dyn Fn(SectionKey) -> Option<Shared>,
    ) -> u64 {
        let (mut first, mut outside) = (0, 0);
        while first < block.len() {
            let (next, nowhere) = self.place(grid, core, meaning, block, first, &mut |_, _| ());
            self.group();
            self.put(meaning, block, first, section);
            (first, outside) = (next, outside + nowhere);
        }
        outside
    }

    /// Adds the points that were placed and grouped, from `first` on; gives the bytes by which sections grew, here and
    /// on the device.
    fn put(
        &mut self,
        meaning: &impl Meaning,
        block: &PointBlock,
        first: usize,
        section_of: &dyn Fn(SectionKey) -> Option<Shared>,
    ) -> [i64; 2] {
        let mut grown = [0i64; 2];
        let mut add = |section: usize, columns: &mut Columns| {
            let before = if columns.points() == 0 {
                [0; 2]
            } else {
                [columns.bytes() as i64, device_bytes(&columns.layout_at_most()) as i64]
            };
            for run in &self.order[self.starts[section] as usize..self.starts[section + 1] as usize] {
                let of_piece = run.first as usize..run.end as usize;
                let (start, heights) = (first + of_piece.start, &self.heights[of_piece.clone()]);
                columns.add_all(&self.columns[of_piece], heights, |i| {
                    record(meaning, block, start + i, heights[i])
                });
            }
            grown[0] += columns.bytes() as i64 - before[0];
            grown[1] += device_bytes(&columns.layout_at_most()) as i64 - before[1];
        };
        // Sections that another thread holds come last, so that threads seldom wait for each other.
        let mut held = Vec::new();
        for (section, &key) in self.keys.iter().enumerate() {
            let Some(shared) = section_of(key) else { continue };
            let busy = match shared.try_lock() {
                Ok(mut columns) => {
                    add(section, &mut columns);
                    false
                }
                Err(TryLockError::Poisoned(columns)) => {
                    add(section, &mut columns.into_inner());
                    false
                }
                Err(TryLockError::WouldBlock) => true,
            };
            if busy {
                held.push((section, shared));
            }
        }
        for (section, shared) in held {
            add(section, &mut lock(&shared));
        }
        grown
    }

    /// Height, column and run of every point from `first` on that has a cell and a height, until the runs lie in
    /// `LIMITS.touched_sections`; gives the next point, and how many have none. Those outside `core` are `stray`.
    fn place(
        &mut self,
        grid: &Grid,
        core: &Core,
        meaning: &impl Meaning,
        block: &PointBlock,
        first: usize,
        stray: &mut dyn FnMut([f64; 2], Record),
    ) -> (usize, u64) {
        self.keys.clear();
        self.index_of.clear();
        self.runs.clear();
        let all = block.len() - first;
        self.columns.resize(all, 0);
        self.heights.resize(all, Height(0));
        let ordinary = Ordinary::new(grid, core);
        let mut outside = 0;
        let mut world = [[0.0; BATCH]; 3];
        let mut cells = [[0; BATCH]; 2];
        let mut at = 0;
        while at < all && self.keys.len() < LIMITS.touched_sections {
            let n = BATCH.min(all - at);
            let [east, north, up] = world.each_mut().map(|w| &mut w[..n]);
            let [i, j] = cells.each_mut().map(|c| &mut c[..n]);
            meaning.world_of_many(block, first + at, [&mut *east, &mut *north, &mut *up]);
            let all_ordinary = ordinary.cells(0, east, i)
                & ordinary.cells(1, north, j)
                & ordinary.heights(up, &mut self.heights[at..at + n]);
            if all_ordinary {
                at = self.place_ordinary(at, i, j);
                continue;
            }
            for k in 0..n {
                if self.keys.len() == LIMITS.touched_sections {
                    break;
                }
                let (Some(cell), Some(height)) = (grid.cell_of(east[k], north[k]), grid.height(up[k])) else {
                    outside += 1;
                    at += 1;
                    continue;
                };
                if is_stray(grid, core, [east[k], north[k]]) {
                    stray([east[k], north[k]], record(meaning, block, first + at, height));
                    at += 1;
                    continue;
                }
                self.heights[at] = height;
                at = self.place_ordinary(at, &[cell.i], &[cell.j]);
            }
        }
        (first + at, outside)
    }

    /// Column and run of points from `at` on, whose cells are these; gives the next point, which is one of them if
    /// there are `LIMITS.touched_sections` now.
    fn place_ordinary(&mut self, at: usize, i: &[i32], j: &[i32]) -> usize {
        let mask = SECTION_SIDE as i32 - 1;
        let columns = &mut self.columns[at..at + i.len()];
        let mut same = true;
        for ((to, &ci), &cj) in columns.iter_mut().zip(i).zip(j) {
            *to = column_index((ci & mask) as u32, (cj & mask) as u32);
            same &= (ci ^ i[0] | cj ^ j[0]) & !mask == 0;
        }
        let mut done = 0;
        while done < i.len() && self.keys.len() < LIMITS.touched_sections {
            let key = SectionKey::of(CellIndex { i: i[done], j: j[done] });
            let first = done;
            done = if same { i.len() } else { done + 1 };
            while done < i.len() && SectionKey::of(CellIndex { i: i[done], j: j[done] }) == key {
                done += 1;
            }
            let (from, end) = ((at + first) as u32, (at + done) as u32);
            if let Some(run) = self.runs.last_mut()
                && run.end == from
                && self.keys[run.section as usize] == key
            {
                run.end = end;
                continue;
            }
            let keys = &mut self.keys;
            let section = *self.index_of.entry(key).or_insert_with(|| {
                keys.push(key);
                keys.len() as u32 - 1
            });
            self.runs.push(Run { section, first: from, end });
        }
        at + done
    }

    /// Sorts the runs by section: a counting sort, order within a section kept.
    fn group(&mut self) {
        self.starts.clear();
        self.starts.resize(self.keys.len() + 1, 0);
        for run in &self.runs {
            self.starts[run.section as usize + 1] += 1;
        }
        for section in 1..self.starts.len() {
            self.starts[section] += self.starts[section - 1];
        }
        let mut next = self.starts.clone();
        self.order.clear();
        self.order.resize(self.runs.len(), Run { section: 0, first: 0, end: 0 });
        for &run in &self.runs {
            let at = &mut next[run.section as usize];
            self.order[*at as usize] = run;
            *at += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coords::HEIGHT_STEP;
    use glam::DVec3;

    struct Plain;

    impl Meaning for Plain {
        fn world(&self, block: &PointBlock, i: usize) -> DVec3 {
            DVec3::new(
                f64::from(block.x[i]) * 0.01,
                f64::from(block.y[i]) * 0.01,
                f64::from(block.z[i]) * 0.01,
            )
        }
        fn rgb(&self, _: &PointBlock, _: usize) -> [u8; 3] {
            [9; 3]
        }
    }

    fn block(points: impl Iterator<Item = (i32, i32, i32)>) -> PointBlock {
        let mut block = PointBlock::default();
        for (x, y, z) in points {
            block.x.push(x);
            block.y.push(y);
            block.z.push(z);
            block.class.push((z % 3) as u8);
            block.flags.push(0);
            block.intensity.push(1);
            block.returns.push(0x11);
        }
        block
    }

    fn scattered(n: i32, reach: i32) -> PointBlock {
        let mut state = 1u64;
        let mut random = move |below: i32| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            ((state >> 33) % below as u64) as i32
        };
        block((0..n).map(|_| (random(reach), random(reach), random(9000))))
    }

    fn grid(coarsen: u32) -> Grid {
        Grid { base_cell: 0.25, coarsen, anchor: [0, 0], height_step: HEIGHT_STEP }
    }

    const EVERYWHERE: [std::ops::Range<i64>; 2] = [-1_000_000..1_000_000, -1_000_000..1_000_000];
    const PLENTY: Budget = Budget { host_bytes: u64::MAX, device_bytes: u64::MAX };

    fn words(binned: &Binned) -> Vec<(SectionKey, Vec<u32>)> {
        binned.sections.iter().map(|(key, columns)| (*key, columns.pack().words)).collect()
    }

    fn both(check: impl Fn(Surface)) {
        [Surface::Columns, Surface::Stacks].into_iter().for_each(check);
    }

    #[test]
    fn threads_and_order_change_nothing() {
        both(|surface| {
            let blocks: Vec<_> = (0..8).map(|k| scattered(5000 + k, 30_000)).collect();
            let one = Bins::new(surface, grid(0), EVERYWHERE, PLENTY);
            let mut binner = Binner::default();
            blocks.iter().for_each(|b| binner.bin(&one, &Plain, b));
            let two = Bins::new(surface, grid(0), EVERYWHERE, PLENTY);
            std::thread::scope(|scope| {
                for half in [&blocks[4..], &blocks[..4]] {
                    let two = &two;
                    scope.spawn(move || {
                        let mut binner = Binner::default();
                        half.iter().rev().for_each(|b| binner.bin(two, &Plain, b));
                    });
                }
            });
            let (one, two) = (one.finish().unwrap(), two.finish().unwrap());
            assert!(one.sections.len() >= 16);
            assert_eq!(words(&one), words(&two));
            assert_eq!(
                one.sections.iter().map(|(_, c)| c.points()).sum::<u64>(),
                blocks.iter().map(|b| b.len() as u64).sum::<u64>()
            );
        });
    }

    /// Ordinary points, strays and what has no cell, in more sections than a piece has: as if each came alone.
    #[test]
    fn many_at_a_time_equal_one_at_a_time() {
        let grid = Grid { base_cell: 0.3, coarsen: 0, anchor: [1 << 24, 0], height_step: HEIGHT_STEP };
        let core = [16_000_000..18_000_000, -20_000_000..20_000_000];
        let mut points = scattered(30_000, 500_000);
        for (i, x) in points.x.iter_mut().enumerate() {
            // The last of the core, strays beyond it, and far more than a cell can be.
            *x += if i % 1000 == 7 { 540_100_000 } else { 503_316_480 };
        }
        for i in (0..30_000).step_by(777) {
            points.y[i] = i32::MIN;
            points.z[i] = if i % 2 == 0 { i32::MAX } else { 1 };
        }
        let bins = Bins::new(Surface::Columns, grid, core.clone(), PLENTY);
        Binner::default().bin(&bins, &Plain, &points);
        let mut one = HashMap::<SectionKey, Columns>::new();
        let (mut strays, mut rest) = (0, 0);
        for i in 0..points.len() {
            let at = Plain.world(&points, i);
            let (Some(cell), Some(height)) = (grid.cell_of(at.x, at.y), grid.height(at.z)) else {
                rest += 1;
                continue;
            };
            if !core[0].contains(&((at.x / 0.3).floor() as i64))
                || !core[1].contains(&((at.y / 0.3).floor() as i64))
            {
                strays += 1;
                continue;
            }
            let side = SECTION_SIDE as i32 - 1;
            let columns = one.entry(SectionKey::of(cell)).or_default();
            columns.add((cell.i & side) as u32, (cell.j & side) as u32, record(&Plain, &points, i, height));
        }
        assert!(one.len() > LIMITS.touched_sections && strays > 40 && rest > 10);
        let binned = bins.finish().unwrap();
        assert_eq!(binned.outside, strays + rest);
        let mut one: Vec<_> = one.into_iter().map(|(key, columns)| (key, columns.pack().words)).collect();
        one.sort_unstable_by_key(|(key, _)| *key);
        assert!(words(&binned) == one);
    }

    #[test]
    fn outgrowing_the_budget_equals_binning_coarser() {
        both(|surface| {
            let points = scattered(40_000, 60_000);
            let all = Bins::new(surface, grid(2), EVERYWHERE, PLENTY);
            Binner::default().bin(&all, &Plain, &points);
            let all = all.finish().unwrap();
            let device_bytes: u64 = all.sections.iter().map(|(_, c)| device_bytes(&c.layout_at_most())).sum();

            let tight =
                Bins::new(surface, grid(0), EVERYWHERE, Budget { device_bytes, host_bytes: u64::MAX });
            Binner::default().bin(&tight, &Plain, &points);
            let tight = tight.finish().unwrap();
            assert_eq!(tight.grid.coarsen, 2);
            assert_eq!(words(&all), words(&tight));
            assert!(
                Bins::new(surface, grid(0), EVERYWHERE, Budget { device_bytes: 0, host_bytes: 0 })
                    .finish()
                    .is_some()
            );
        });
    }

    #[test]
    fn a_few_strays_are_kept_and_a_cloud_of_them_is_not() {
        let core = [0..2000, 0..2000];
        let few = Bins::new(Surface::Columns, grid(0), core.clone(), PLENTY);
        Binner::default().bin(&few, &Plain, &block([(100, 100, 0), (20_000_000, 5, 3)].into_iter()));
        assert_eq!(few.finish().unwrap().sections.len(), 2);

        let many = Bins::new(Surface::Columns, grid(0), core, PLENTY);
        let cloud = (0..100).map(|k| (k * 1_000_000, -k * 700_000, 5));
        Binner::default().bin(&many, &Plain, &block(cloud));
        let many = many.finish().unwrap();
        assert_eq!((many.sections.len(), many.outside), (1, 99));
    }

    #[test]
    fn what_has_no_cell_or_height_is_counted() {
        let bins = Bins::new(
            Surface::Columns,
            Grid { base_cell: 1e-9, coarsen: 0, anchor: [0, 0], height_step: HEIGHT_STEP },
            EVERYWHERE,
            PLENTY,
        );
        Binner::default().bin(&bins, &Plain, &block([(0, 0, 0), (i32::MAX, 0, 0)].into_iter()));
        assert_eq!(bins.finish().unwrap().outside, 1);
    }
}
