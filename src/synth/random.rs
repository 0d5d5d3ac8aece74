//! Hashed randomness: the same (seed, kind, i, j) gives the same town everywhere, in any order.

use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

/// What a hashed lattice decides, so that no two decisions share their numbers.
#[derive(Clone, Copy)]
#[repr(u32)]
pub enum Topic {
    UStreet = 1,
    VStreet,
    CrossStreet,
    Block,
    Lots,
    Village,
    Parcel,
    ParcelRow,
    ForestTree,
    OrchardTree,
    HedgeRow,
    RiverTree,
    AvenueTree,
    Scan,
    Traffic,
}

/// A well-mixed 64-bit hash (the finaliser of SplitMix64 over the folded key).
#[inline]
pub fn mix(seed: u64, topic: Topic, i: i64, j: i64) -> u64 {
    let mut z = seed
        ^ (topic as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        ^ (i as u64).wrapping_mul(0xd6e8_feb8_6659_fd93)
        ^ (j as u64).wrapping_mul(0xa076_1d64_78bd_642f).rotate_left(32);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A hash as a number in [0, 1).
#[inline]
pub fn unit(hash: u64) -> f64 {
    (hash >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
}

/// A generator for everything that one lattice place decides.
pub fn stream(seed: u64, topic: Topic, i: i64, j: i64) -> Pcg64Mcg {
    Pcg64Mcg::seed_from_u64(mix(seed, topic, i, j))
}

/// `x.floor()` without the library call that x86-64's baseline makes of it: several are due for each point.
#[inline]
pub fn floor(x: f64) -> i64 {
    let truncated = x as i64;
    truncated - i64::from(x < truncated as f64)
}

/// Smooth value noise of unit wavelength in [-1, 1]: texture of surfaces, cheap enough for every point.
#[inline]
pub fn grain(salt: u32, x: f64, y: f64) -> f64 {
    let (fx, fy) = (floor(x), floor(y));
    let (i, j) = (fx as u32, fy as u32);
    let smooth = |t: f64| t * t * (3.0 - 2.0 * t);
    let (tx, ty) = (smooth(x - fx as f64), smooth(y - fy as f64));
    let corner = |i: u32, j: u32| {
        let mut h =
            i.wrapping_mul(0x85eb_ca6b) ^ j.wrapping_mul(0xc2b2_ae35) ^ salt.wrapping_mul(0x27d4_eb2f);
        h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
        h ^= h >> 13;
        f64::from(h.wrapping_mul(0x297a_2d39)) * (2.0 / 4_294_967_296.0) - 1.0
    };
    let (i1, j1) = (i.wrapping_add(1), j.wrapping_add(1));
    let south = corner(i, j) + (corner(i1, j) - corner(i, j)) * tx;
    let north = corner(i, j1) + (corner(i1, j1) - corner(i, j1)) * tx;
    south + (north - south) * ty
}
