//! Oklab, in which equal distances look alike.

/// Oklab of an sRGB colour, in which equal distances look alike. Source: B. Ottosson, 2020.
pub(super) fn srgb_to_oklab(rgb: [f64; 3]) -> [f64; 3] {
    let [r, g, b] = rgb.map(|v| if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) });
    let l = (0.4122214708 * r + 0.5363325363 * g + 0.0514459929 * b).cbrt();
    let m = (0.2119034982 * r + 0.6806995451 * g + 0.1073969566 * b).cbrt();
    let s = (0.0883024619 * r + 0.2817188376 * g + 0.6299787005 * b).cbrt();
    [
        0.2104542553 * l + 0.7936177850 * m - 0.0040720468 * s,
        1.9779984951 * l - 2.4285922050 * m + 0.4505937099 * s,
        0.0259040371 * l + 0.7827717662 * m - 0.8086757660 * s,
    ]
}

/// Inverse of [`srgb_to_oklab`]; outside 0 to 1 where sRGB has no such colour.
pub(super) fn oklab_to_srgb([lightness, a, b]: [f64; 3]) -> [f64; 3] {
    let l = (lightness + 0.3963377774 * a + 0.2158037573 * b).powi(3);
    let m = (lightness - 0.1055613458 * a - 0.0638541728 * b).powi(3);
    let s = (lightness - 0.0894841775 * a - 1.2914855480 * b).powi(3);
    [
        4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s,
        -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s,
        -0.0041960863 * l - 0.7034186147 * m + 1.7076147010 * s,
    ]
    .map(|v| if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 })
}

/// Oklab colour at the share `t` of the way along straight lines between `stops`.
pub(super) fn even_path(stops: &[[u8; 3]], t: f64) -> [f64; 3] {
    let labs: Vec<_> = stops.iter().map(|c| srgb_to_oklab(c.map(|v| f64::from(v) / 255.0))).collect();
    let lengths: Vec<f64> = labs.windows(2).map(|w| oklab_distance(w[0], w[1])).collect();
    let mut left = t * lengths.iter().sum::<f64>();
    for (k, &length) in lengths.iter().enumerate() {
        if left <= length || k + 1 == lengths.len() {
            let f = (left / length).min(1.0);
            return [0, 1, 2].map(|c| labs[k][c] + (labs[k + 1][c] - labs[k][c]) * f);
        }
        left -= length;
    }
    unreachable!("a ramp has at least two stops")
}

pub(super) fn oklab_distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
}
