//! How the budget of host memory (`--host-memory`) is shared out. The shares add up to it, so that all of it together
//! stays within.
//!
//! Beside it stands what does not grow with the data: a few MiB of buffers for each thread, and the sparse sample. One
//! section, or one chunk's points, is always worked on, or nothing would ever be: where a share is smaller than a single
//! section, that section is what is held.

use crate::limits::LIMITS;

/// Bytes for the layers of the chunks that are being decoded.
pub fn layer_bytes(host_bytes: u64) -> u64 {
    (host_bytes / LIMITS.layers_part).min(LIMITS.layer_bytes)
}

/// The shares, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shares {
    /// Sections that are being made, and those that are finished and wait to be packed.
    pub builds: u64,
    /// Packed ones on their way from the threads.
    pub arriving: u64,
    /// Packed ones that wait to be uploaded. Another may come while they are less, hence as much again as is `arriving`
    /// is set aside for them.
    pub arrived: u64,
    /// Packed ones kept after they were uploaded.
    pub kept: u64,
    /// Layers of chunks that are being decoded.
    pub layers: u64,
}

impl Shares {
    /// Of `host_bytes`.
    pub fn of(host_bytes: u64) -> Shares {
        let (arriving, arrived, kept) = (
            host_bytes / LIMITS.arriving_part,
            host_bytes / LIMITS.arrived_part,
            host_bytes / LIMITS.kept_part,
        );
        let layers = layer_bytes(host_bytes);
        Shares {
            builds: host_bytes - 2 * arriving - arrived - kept - layers,
            arriving,
            arrived,
            kept,
            layers,
        }
    }

    /// All of them.
    #[cfg(test)]
    fn sum(&self) -> u64 {
        self.builds + 2 * self.arriving + self.arrived + self.kept + self.layers
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_add_up_to_the_budget() {
        for bytes in [1, 31, 4 << 20, (2 << 30) + 7, 1 << 40, u64::MAX] {
            let shares = Shares::of(bytes);
            assert_eq!(shares.sum(), bytes);
            assert!(shares.builds >= bytes / 2);
        }
    }
}
