//! Bands: large images are drawn in rows, so that no submit runs for long; and how large an image may be.

use super::error::FrameError;
use super::options::GROUP;
use crate::gpu::Gpu;
use crate::shared::passes::WIDE_TILE;

/// Rays that one submit traces: large images go in bands of rows, one sample of a pixel at a time, so that no
/// submit runs for long (drivers end those that do) and device memory does not grow with the image.
const SUBMIT_RAYS: u64 = 1 << 21;
/// Most pixels of an image: 32 bytes each in host memory.
const MOST_PIXELS: u64 = 1 << 27;

/// And of its sides: rays count pixels from the middle, beams' corners up to a wide tile beyond the edge, and shaders
/// multiply that by 16 bits in 31.
const MOST_SIDE: u32 = 65_400;
const _: () = assert!(MOST_SIDE / 2 + WIDE_TILE < 1 << 15);

/// An error where an image of `size` cannot be drawn.
pub fn check_size(gpu: &Gpu, size: [u32; 2]) -> Result<(), FrameError> {
    let limits = gpu.limits();
    let too_large = |limit| FrameError::Size { width: size[0], height: size[1], limit };
    let most = u64::from(GROUP[0]) * u64::from(limits.workgroups[0]);
    if size.iter().any(|&pixels| pixels > MOST_SIDE) {
        return Err(too_large(format!("{MOST_SIDE} pixels a side")));
    }
    if u64::from(size[0]) > most {
        return Err(too_large(format!("{most} pixels across")));
    }
    if u64::from(size[0]) * u64::from(size[1]) > MOST_PIXELS {
        return Err(too_large(format!("{MOST_PIXELS} pixels in all")));
    }
    Ok(())
}

/// Rows of one band of an image of `size`.
pub(super) fn band_rows(size: [u32; 2]) -> u32 {
    let rows = (SUBMIT_RAYS / u64::from(size[0])).max(1) as u32;
    rows.next_multiple_of(GROUP[1]).min(size[1])
}

/// Part of an image that one submit works on.
#[derive(Clone, Copy)]
pub(in super::super) struct Band {
    pub first_row: u32,
    pub rows: u32,
    pub sample: u32,
    pub samples: u32,
    /// What it draws is copied back.
    pub read: bool,
    /// Bytes for the screen, where the image is exact, instead of sums and records.
    pub screen: bool,
    /// Sums and records of the whole image are kept, not of the band alone.
    pub whole: bool,
}
