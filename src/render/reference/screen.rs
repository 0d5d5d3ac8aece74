//! The twin of `shaders/screen.comp`: sums of linear colours to sRGB codes, in f64.

/// Codes of the channels of `sum` times `scale` before they are rounded to bytes, 0 to 255.
pub fn codes(sum: [f32; 4], scale: f32) -> [f64; 3] {
    [0, 1, 2].map(|k| 255.0 * encoded((f64::from(sum[k]) * f64::from(scale)).clamp(0.0, 1.0)))
}

/// IEC 61966-2-1.
fn encoded(v: f64) -> f64 {
    if v > 0.003_130_8 { 1.055 * v.powf(1.0 / 2.4) - 0.055 } else { v * 12.92 }
}
