//! What payloads take of the pool's pages.

use offset_allocator::ext::min_allocator_size;

/// Payloads start at multiples of this, of cache lines above all. The allocator's classes of sizes being what they are, a
/// derived part of 16-bit codes takes 1 % more than it needs; with 256 it would be 10 %.
pub const ALIGN: u64 = 192;

/// What `bytes` take of a page, units of [`ALIGN`]. The allocator keeps free space by size classes, and looks into
/// those alone that hold nothing smaller than what is asked for: a place of a class's very size (at most 12.5 %
/// more) is found again when it is free.
pub fn units(bytes: u64) -> u32 {
    let units = u32::try_from(bytes.div_ceil(ALIGN)).unwrap_or(u32::MAX);
    if units > 1 << 31 { units } else { min_allocator_size(units) }
}

/// Bytes of a page that a payload of `bytes` takes.
pub fn slot_bytes(bytes: u64) -> u64 {
    u64::from(units(bytes)) * ALIGN
}
