//! sRGB-encoded channels and linear light.

/// sRGB-encoded channel in 0 to 1 → linear light (IEC 61966-2-1).
pub fn srgb_to_linear(v: f32) -> f32 {
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// Linear light in 0 to 1 → sRGB-encoded channel (IEC 61966-2-1).
pub fn linear_to_srgb(v: f32) -> f32 {
    if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::super::oklab::{oklab_to_srgb, srgb_to_oklab};
    use super::*;

    #[test]
    fn srgb_and_linear_are_inverse() {
        for k in 0..=255u8 {
            let v = f32::from(k) / 255.0;
            assert!((linear_to_srgb(srgb_to_linear(v)) - v).abs() < 1e-6);
            let lab = oklab_to_srgb(srgb_to_oklab([f64::from(v), 0.5, 1.0 - f64::from(v)]));
            assert!((lab[0] - f64::from(v)).abs() < 1e-5 && (lab[1] - 0.5).abs() < 1e-5);
        }
        assert!((srgb_to_linear(0.5) - 0.214_041).abs() < 1e-5);
    }
}
