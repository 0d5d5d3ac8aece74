//! How much the opening sample reads.

/// How much is read.
#[derive(Clone, Copy, Debug)]
pub struct SampleBudget {
    /// A set of this many points is read whole.
    pub whole: u64,
    /// And of this many where certain classes or points are asked for: of rare ones a sample would tell little.
    pub whole_of_classes: u64,
    /// Places at which whole chunks are read.
    pub places: u64,
    /// Points wanted at a place.
    pub place_points: u64,
    /// Most points decoded for one window of a COPC file, which takes nodes of every level.
    pub window_points: u64,
    /// First points over all files.
    pub first_points: usize,
    /// Chunks of which the first 1,024 points are read.
    pub heads: u64,
}

impl Default for SampleBudget {
    fn default() -> SampleBudget {
        SampleBudget {
            whole: 250_000,
            whole_of_classes: 2_000_000,
            places: 4,
            place_points: 50_000,
            window_points: 400_000,
            first_points: 65_536,
            heads: 64,
        }
    }
}
