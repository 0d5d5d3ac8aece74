//! The sparse sample: a few points of every chunk of every file, the first picture of everything. What was read of a file
//! is remembered, so that files may come and go without the others being read again.

use crate::limits::LIMITS;
use crate::source::known::RawBounds;
use crate::source::{Decoder, LidarFile, PointBlock};

/// Points that each of so many files gives, at most: a power of two, so that a few files more or less change nothing.
pub fn points_of_file(files: usize) -> usize {
    let most = (LIMITS.sample_points / files.max(1)).max(1);
    1 << most.ilog2()
}

/// Records of a chunk that a sample of `most` points of a file takes: of LAS, any can be read alone, of others the
/// first is stored raw.
fn records_of_chunk(file: &LidarFile, most: usize) -> u64 {
    if file.header.compressed {
        return 1;
    }
    (most / file.chunks.len().max(1)).clamp(1, LIMITS.sample_chunk_records as usize) as u64
}

/// Points in the sample of such files.
pub fn points<'a>(files: impl Iterator<Item = &'a LidarFile> + Clone) -> u64 {
    let most = points_of_file(files.clone().count());
    let of_file = |file: &LidarFile| {
        (file.chunks.len().min(most) as u64 * records_of_chunk(file, most)).min(file.points())
    };
    files.map(of_file).sum()
}

/// Points of the sample that a cell of its sections is to hold, about.
const POINTS_OF_CELL: u64 = 3;
/// Levels that its sections are coarser than the coarsest others, at least.
const LEVELS_ABOVE: u8 = 1;
/// Its coarsest level: the grid's anchor allows for no more.
pub const COARSEST_LEVEL: u8 = 20;

/// Level of the sections of a sample of `points` over `cells` finest cells; `root`: of the coarsest other sections.
pub fn level(points: u64, cells: f64, root: u8) -> u8 {
    let of_level = |level: u8| cells * (-2.0 * f64::from(level)).exp2();
    let enough = |level: &u8| of_level(*level) * POINTS_OF_CELL as f64 <= points as f64;
    (root + LEVELS_ABOVE..COARSEST_LEVEL).find(enough).unwrap_or(COARSEST_LEVEL)
}

/// The sample of a file.
#[derive(Default)]
pub struct Sparse {
    blocks: Vec<PointBlock>,
    bounds: Vec<(usize, RawBounds)>,
    most: usize,
    has_all: bool,
    is_whole: bool,
}

impl Sparse {
    /// Reads up to about `most` points. What cannot be read is named when it is read for good.
    pub fn read(decoder: &mut Decoder, file: &LidarFile, most: usize) -> Sparse {
        let mut sparse = Sparse { most, is_whole: true, ..Sparse::default() };
        if file.chunks.is_empty() {
            return sparse;
        }
        let of_chunk = records_of_chunk(file, most);
        let stride = if of_chunk == 1 { Decoder::stride_of_firsts(file, most) } else { 1 };
        let most_of_chunk = if file.header.compressed { 1 } else { LIMITS.sample_chunk_records };
        sparse.has_all = stride == 1 && of_chunk == most_of_chunk;
        let mut chunk_of_point = file.chunks.iter().enumerate().step_by(stride).flat_map(|(index, chunk)| {
            std::iter::repeat_n(index, if of_chunk == 1 { 1 } else { of_chunk.min(chunk.records) as usize })
        });
        let mut take = |block: &PointBlock| {
            sparse.take(block, &mut chunk_of_point);
        };
        let read = match of_chunk {
            1 => decoder.first_points(file, most).map(&mut take),
            of_chunk => decoder.sparse_records(file, of_chunk, &mut take),
        };
        sparse.is_whole = read.is_ok();
        file.bytes.release();
        sparse
    }

    fn take(&mut self, block: &PointBlock, chunk_of_point: &mut impl Iterator<Item = usize>) {
        for (i, index) in (0..block.len()).zip(chunk_of_point) {
            if self.bounds.last().is_none_or(|(last, _)| *last != index) {
                self.bounds.push((index, RawBounds::NOTHING));
            }
            let (_, bounds) = self.bounds.last_mut().expect("just pushed");
            for (axis, values) in [&block.x, &block.y, &block.z].into_iter().enumerate() {
                bounds.widen(axis, &values[i..=i]);
            }
        }
        self.blocks.push(block.clone());
    }

    /// Points that it was to have, about.
    pub fn most(&self) -> usize {
        self.most
    }

    /// No sample takes more of its file.
    pub fn has_all(&self) -> bool {
        self.has_all
    }

    /// Nothing stood in the way of reading it.
    pub fn is_whole(&self) -> bool {
        self.is_whole
    }

    /// Its points.
    pub fn blocks(&self) -> &[PointBlock] {
        &self.blocks
    }

    /// What they say of chunks: index, and a box that the chunk's own holds.
    pub fn bounds(&self) -> &[(usize, RawBounds)] {
        &self.bounds
    }
}
