//! Heights on one lattice, and how fine it is.

/// Step of the heights' lattice where nothing speaks against it, CRS units: 2⁻¹⁰.
pub const HEIGHT_STEP: f64 = 1.0 / 1024.0;
/// Smallest cell for which that is fine enough.
const LEAST_CELL_OF_HEIGHT_STEP: f64 = 1.0 / 64.0;
/// Height steps in a cell of another size, or up to twice as many.
const STEPS_IN_A_CELL: f64 = 256.0;
/// Steps from U = 0 to the highest and lowest of most heights: 31 bits with the sign. [`Height`] has one more, for what
/// stands out of them and for differences.
pub const HEIGHT_REACH: f64 = (1u32 << 30) as f64;

/// A height on the lattice of [`super::Grid::height_step`]: `ceil(U / step)`. `i32::MIN` never occurs: it stands for "no point".
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Height(pub i32);

/// The step of the lattice, anchored at U = 0, for cells of `cell` and heights most of which lie between `low` and
/// `high` (CRS units): [`HEIGHT_STEP`] if cells are not tiny and 31 bits count those heights in it, else the largest
/// power of two that is at most 1/256 of a cell, raised until they do. `None` where it would be larger than a cell:
/// the heights then are too many cells from 0 to be told apart.
pub fn height_step(cell: f64, [low, high]: [f64; 2]) -> Option<f64> {
    // As far as it takes: the smallest step that counts the heights.
    let least = low.abs().max(high.abs()) / HEIGHT_REACH;
    if cell >= LEAST_CELL_OF_HEIGHT_STEP && least <= HEIGHT_STEP {
        return Some(HEIGHT_STEP);
    }
    let step = power_of_two_at_most(cell / STEPS_IN_A_CELL);
    let step = if least <= step { step } else { power_of_two_at_most(least.next_down()) * 2.0 };
    (step <= cell && step.is_normal() && step.recip().is_normal()).then_some(step)
}

/// The largest power of two that is at most `size`, which is positive and finite.
pub fn power_of_two_at_most(size: f64) -> f64 {
    // The exponent alone; what is smaller than those that have one becomes 0.
    f64::from_bits(size.to_bits() & 0x7FF0_0000_0000_0000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_step_follows_cells_and_heights() {
        let step = |cell: f64, low: f64, high: f64| height_step(cell, [low, high]);
        // Ordinary surveys, and very coarse cells.
        assert_eq!(step(0.5, -400.0, 8_848.0), Some(HEIGHT_STEP));
        assert_eq!(step(1.0 / 64.0, 0.0, 0.0), Some(HEIGHT_STEP));
        assert_eq!(step(1e6, 0.0, 1e6), Some(HEIGHT_STEP));
        // Small things: 1/256 of a cell, rounded down.
        assert_eq!(step(1.0 / 128.0, 0.0, 3.0), Some(1.0 / 32_768.0));
        assert_eq!(step(0.01, 0.0, 3.0), Some(1.0 / 32_768.0));
        // Millimetres at 3,000 m, centimetres at 10⁸, metres from the centre of the Earth.
        assert_eq!(step(512.0, 2_990_000.0, 3_010_000.0), Some(2.0));
        assert_eq!(step(32.0, 99_990_000.0, 100_020_000.0), Some(0.125));
        assert_eq!(step(0.5, 5e6, 5.1e6), Some(1.0 / 128.0));
        assert_eq!(step(1.0, -1e8, 1e8), Some(0.125));
        // 31 bits, to the step.
        let reach = f64::from(1 << 20);
        assert_eq!(step(1.0, -reach, reach), Some(HEIGHT_STEP));
        assert_eq!(step(1.0, 0.0, reach.next_up()), Some(1.0 / 256.0));
        let reach = f64::from(1 << 22);
        assert_eq!(step(1.0, 0.0, reach), Some(1.0 / 256.0));
        assert_eq!(step(1.0, 0.0, reach.next_up()), Some(1.0 / 128.0));
        // A step as large as a cell, and no larger.
        assert_eq!(step(1.0, 0.0, f64::from(1 << 30)), Some(1.0));
        assert_eq!(step(1.0, 0.0, f64::from(1 << 30).next_up()), None);
        assert_eq!(step(1e-30, 0.0, 0.0).map(|step| step.log2()), Some(-108.0));
        assert_eq!(step(1e-320, 0.0, 0.0), None);
    }
}
