//! What is known of where a chunk's points lie before it is read, and who says so. Nobody is believed blindly: whoever
//! reads points compares.

use super::{Chunk, FileHeader, LidarFile};
use glam::DVec3;

/// A box of raw coordinates, both ends included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RawBounds {
    /// Smallest X, Y, Z of a record.
    pub min: [i32; 3],
    /// Largest ones.
    pub max: [i32; 3],
}

impl RawBounds {
    /// Holds nothing: to be widened.
    pub const NOTHING: RawBounds = RawBounds { min: [i32::MAX; 3], max: [i32::MIN; 3] };

    /// Whether there is a point that it may hold.
    pub fn is_sound(&self) -> bool {
        (0..3).all(|axis| self.min[axis] <= self.max[axis])
    }

    /// Whether the point lies within.
    pub fn holds(&self, point: [i32; 3]) -> bool {
        (0..3).all(|axis| (self.min[axis]..=self.max[axis]).contains(&point[axis]))
    }

    /// Takes in values of an axis.
    pub fn widen(&mut self, axis: usize, values: &[i32]) {
        let start = (self.min[axis], self.max[axis]);
        let fold = |(low, high): (i32, i32), &value: &i32| (low.min(value), high.max(value));
        (self.min[axis], self.max[axis]) = values.iter().fold(start, fold);
    }

    /// The box in file coordinates.
    pub fn unpacked(&self, header: &FileHeader) -> [DVec3; 2] {
        [self.min, self.max].map(|raw| DVec3::from(raw.map(f64::from)) * header.scale + header.offset)
    }

    /// Whether it lies in the header's bounds, as far as those are any.
    pub(super) fn in_header(&self, header: &FileHeader) -> bool {
        let [low, high] = self.unpacked(header);
        let (min, max) = (header.min - header.scale, header.max + header.scale);
        let is_box = min.is_finite() && max.is_finite() && min.cmple(max).all();
        !is_box || low.cmpge(min).all() && high.cmple(max).all()
    }
}

/// Who says where points lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Told {
    /// The file: its header, or the nodes of its COPC hierarchy.
    File,
    /// A spatial index that belongs to it.
    Index,
    /// What was learned when it was read before.
    Cache,
    /// Its points, read by this process.
    Points,
}

impl Told {
    /// What is said where points lie elsewhere.
    pub fn contradicted(self) -> &'static str {
        match self {
            Told::File => "points lie outside of the bounds that its header gives: all of it is looked at",
            Told::Index => {
                "points lie outside of the cells that its spatial index (.lax) has them in: it is not used"
            }
            Told::Cache => "points lie outside of the bounds that were kept of it: those are dropped",
            Told::Points => "points lie outside of where they were when they were read before",
        }
    }
}

/// Bounds of chunks, each with who says so.
#[derive(Clone, Debug, Default)]
pub struct Known(Vec<Option<(Told, RawBounds)>>);

impl Known {
    /// One a chunk, where it is known.
    pub fn new(told: Told, bounds: Vec<Option<RawBounds>>) -> Known {
        Known(bounds.into_iter().map(|bounds| Some((told, bounds?))).collect())
    }

    /// Of a chunk.
    pub fn of(&self, chunk: &Chunk) -> Option<(Told, RawBounds)> {
        self.0.get(chunk.index as usize).copied().flatten()
    }

    /// Whether every chunk of a file is known.
    pub fn is_whole(&self, file: &LidarFile) -> bool {
        self.0.len() == file.chunks.len() && self.0.iter().all(Option::is_some)
    }

    /// What `others` know and this does not.
    pub fn fill_from(&mut self, others: Known) {
        self.0.resize(self.0.len().max(others.0.len()), None);
        for (known, other) in self.0.iter_mut().zip(others.0) {
            *known = known.or(other);
        }
    }

    /// Who is wrong, if first points of chunks, at an even stride from the first on, lie elsewhere.
    pub fn contradicted(
        &self,
        file: &LidarFile,
        firsts: impl ExactSizeIterator<Item = [i32; 3]>,
    ) -> Option<Told> {
        let stride = file.chunks.len().div_ceil(firsts.len().max(1)).max(1);
        file.chunks.iter().step_by(stride).zip(firsts).find_map(|(chunk, point)| {
            let (told, bounds) = self.of(chunk)?;
            (!bounds.holds(point)).then_some(told)
        })
    }
}
