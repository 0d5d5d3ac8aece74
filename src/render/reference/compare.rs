//! How a rendered image differs from what the rays of the reference hit.

use super::trace::{Face, Hit};
use crate::render::camera::RayBasis;
use crate::render::image::MISS_CLASS;
use std::fmt;

/// What a rendered distance may be off by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Finest cell, CRS units.
    pub cell_size: f64,
    /// One step of the stored heights, CRS units.
    pub height_step: f64,
}

impl Tolerance {
    /// Distance that the rendering may be off by at `hit`: c/1000 over the ray's horizontal share, plus
    /// a stored height step over its vertical one, plus 2 ulp. A top or bottom met by a ray within
    /// c/1000 of a plumb line is owed no horizontal part: there it would excuse everything.
    pub fn at(&self, hit: &Hit, basis: &RayBasis, px: f64, py: f64) -> f64 {
        let (d, length) = (basis.direction(px, py), basis.length(px, py));
        let level = d.x.hypot(d.y) / length;
        let is_flat = matches!(hit.face, Face::Top | Face::Bottom);
        let horizontal = if is_flat && level < 1e-3 { 0.0 } else { self.cell_size / 1000.0 / level };
        let horizontal = if hit.face == Face::Inside { 0.0 } else { horizontal };
        let vertical = if hit.face == Face::Inside { 0.0 } else { self.height_step / (d.z.abs() / length) };
        let nearest = hit.distance as f32;
        horizontal + vertical + 2.0 * f64::from(nearest.next_up() - nearest)
    }
}

/// How a rendered image differs from the reference.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// Pixels compared.
    pub pixels: usize,
    /// Pixels on which the reference hits.
    pub hits: usize,
    /// Hit in one, miss in the other.
    pub hit_or_miss_differs: usize,
    /// Hit in both, of another class.
    pub class_differs: usize,
    /// Same class, but the distance is beyond the tolerance.
    pub distance_differs: usize,
    /// Same class, where the tolerance is wider than a cell (flat rays): distance hardly checked.
    pub loose: usize,
    /// A few pixels of each kind of difference, the first ones, or for distances the worst.
    pub examples: Vec<Difference>,
}

/// One pixel that differs.
#[derive(Clone, Copy, Debug)]
pub struct Difference {
    /// Column and row.
    pub pixel: [u32; 2],
    /// What it should be.
    pub reference: Option<Hit>,
    /// What was rendered.
    pub distance: f32,
    /// What was rendered.
    pub class: u32,
    /// Distance off, in tolerances; 0 where hit, miss or class differ.
    pub tolerances: f64,
}

/// Compares planes `distance` (+inf on a miss) and `class` ([`MISS_CLASS`] on a miss) of `width` ×
/// `height` pixels with the reference.
///
/// # Panics
/// When the planes' lengths differ.
pub fn compare(
    reference: &[Option<Hit>],
    basis: &RayBasis,
    width: u32,
    distance: &[f32],
    class: &[u32],
    tolerance: Tolerance,
) -> Comparison {
    assert!(reference.len() == distance.len() && reference.len() == class.len(), "images of unequal size");
    const EXAMPLES: usize = 8;
    let mut result = Comparison {
        pixels: reference.len(),
        hits: reference.iter().flatten().count(),
        hit_or_miss_differs: 0,
        class_differs: 0,
        distance_differs: 0,
        loose: 0,
        examples: Vec::new(),
    };
    let mut far: Vec<Difference> = Vec::new();
    for (k, (&want, (&distance, &class))) in reference.iter().zip(distance.iter().zip(class)).enumerate() {
        let pixel = [(k % width as usize) as u32, (k / width as usize) as u32];
        let difference = Difference { pixel, reference: want, distance, class, tolerances: 0.0 };
        let missed = class == MISS_CLASS && distance == f32::INFINITY;
        let hit = class < MISS_CLASS && distance.is_finite();
        match want {
            None if missed => {}
            Some(want) if hit && class == u32::from(want.class) => {
                let [px, py] = pixel.map(f64::from);
                let allowed = tolerance.at(&want, basis, px, py);
                let off = (f64::from(distance) - want.distance).abs();
                result.loose += usize::from(allowed > tolerance.cell_size);
                if off > allowed {
                    result.distance_differs += 1;
                    far.push(Difference { tolerances: off / allowed, ..difference });
                }
            }
            _ => {
                let count = if want.is_some() && hit {
                    &mut result.class_differs
                } else {
                    &mut result.hit_or_miss_differs
                };
                *count += 1;
                if *count <= EXAMPLES {
                    result.examples.push(difference);
                }
            }
        }
    }
    far.sort_by(|a, b| b.tolerances.total_cmp(&a.tolerances));
    result.examples.extend(far.into_iter().take(EXAMPLES));
    result
}

impl Comparison {
    /// Share of the pixels that agree on hit or miss and on class.
    pub fn agreement(&self) -> f64 {
        let differ = self.hit_or_miss_differs + self.class_differs;
        if self.pixels == 0 { 1.0 } else { 1.0 - differ as f64 / self.pixels as f64 }
    }

    /// At least `share` of the pixels agree, and on those every distance lies within the tolerance.
    pub fn agrees(&self, share: f64) -> bool {
        self.agreement() >= share && self.distance_differs == 0
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{} pixels, {} hits: {:.4} % agree; hit or miss differs on {}, class on {}, distance on {}; {} are \
             loosely checked",
            self.pixels,
            self.hits,
            self.agreement() * 100.0,
            self.hit_or_miss_differs,
            self.class_differs,
            self.distance_differs,
            self.loose
        )?;
        for d in &self.examples {
            write!(f, "  pixel {},{}: class {} at {}", d.pixel[0], d.pixel[1], d.class, d.distance)?;
            match d.reference {
                None => write!(f, ", should miss")?,
                Some(h) => write!(
                    f,
                    ", should be class {} at {} ({:?} of cell {},{}, U {})",
                    h.class, h.distance, h.face, h.cell[0], h.cell[1], h.height
                )?,
            }
            if d.tolerances > 0.0 {
                write!(f, ": {:.1} tolerances off", d.tolerances)?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}
