//! The paths that benchmarks fly, made for the data.

use super::camera::Projection;
use super::path::{Aim, CameraPath, DEFAULT_FPS, Interpolation, Keyframe, PathFault};
use glam::DVec2;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Where the paths of the benchmark are flown. CRS units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathStage {
    /// E, N of what is seen.
    pub center: DVec2,
    /// Usual height of the ground.
    pub ground: f64,
    /// Height of the highest thing.
    pub top: f64,
    /// Side of a finest cell.
    pub cell: f64,
    /// Side of the window that can be seen.
    pub side: f64,
}

/// Seconds of a benchmark path.
const SECONDS: f64 = 20.0;
/// Units a second of the slow ones.
const SLOW: f64 = 10.0;
/// Finest cells east a frame of the fast one: a section.
pub const FAST_CELLS: u32 = 256;

/// The paths of the benchmark, 20 s of 60 frames each.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, clap::ValueEnum)]
pub enum PathKind {
    /// Nothing moves.
    #[value(name = "at-rest", alias = "rest")]
    Rest,
    /// A full turn on the spot.
    Turn,
    /// Straight over the data, 10 units a second, looking ahead and down.
    Slow,
    /// 256 finest cells east a frame, never coming back.
    Fast,
    /// From high above down to just over the highest thing.
    Descent,
    /// Just over the highest thing, nearly level, 10 units a second.
    Grazing,
    /// A random walk of place and heading.
    Random,
}

impl PathKind {
    /// In the order of reports.
    pub const ALL: [PathKind; 7] = [
        PathKind::Rest,
        PathKind::Turn,
        PathKind::Slow,
        PathKind::Fast,
        PathKind::Descent,
        PathKind::Grazing,
        PathKind::Random,
    ];

    /// In reports.
    pub fn name(self) -> &'static str {
        match self {
            PathKind::Rest => "at rest",
            PathKind::Turn => "turn",
            PathKind::Slow => "slow",
            PathKind::Fast => "fast",
            PathKind::Descent => "descent",
            PathKind::Grazing => "grazing",
            PathKind::Random => "random",
        }
    }

    /// The path over `stage`; `seed` matters to the random one alone. No eye is below `stage.top`.
    ///
    /// Errors: a stage that is not finite, or too far out for a camera.
    pub fn path(self, stage: &PathStage, seed: u64) -> Result<CameraPath, PathFault> {
        let PathStage { center, ground, top, cell, side } = *stage;
        let top = top.max(ground);
        let at = |time: f64, place: DVec2, height: f64, azimuth: f64, elevation: f64| Keyframe {
            time,
            eye: place.extend(height),
            aim: Aim::Angles([azimuth, elevation]),
        };
        // A straight flight with its middle over the centre.
        let flight = |azimuth: f64, speed: f64, height: f64, elevation: f64| {
            let half = heading(azimuth) * (0.5 * speed * SECONDS);
            [(0.0, center - half), (SECONDS, center + half)]
                .map(|(time, place)| at(time, place, height, azimuth, elevation))
                .to_vec()
        };
        let mut interpolation = Interpolation::Linear;
        let keyframes = match self {
            PathKind::Rest => {
                let south = center - DVec2::Y * (0.35 * side);
                [0.0, SECONDS].map(|t| at(t, south, top + 0.2 * side, 0.0, 30.0)).to_vec()
            }
            PathKind::Turn => [(0.0, 0.0), (SECONDS, 360.0)]
                .map(|(time, azimuth)| at(time, center, top + 0.1 * side, azimuth, 20.0))
                .to_vec(),
            PathKind::Slow => flight(60.0, SLOW, top + 0.1 * side, 28.0),
            PathKind::Fast => {
                // From the middle of a cell, so that no rounding takes a step into another one.
                let start = ((center / cell).floor() + 0.5) * cell;
                let step = DVec2::X * f64::from(FAST_CELLS) * cell;
                [(0.0, start), (SECONDS, start + step * (SECONDS * DEFAULT_FPS))]
                    .map(|(time, place)| at(time, place, top + 0.1 * side, 90.0, 28.0))
                    .to_vec()
            }
            PathKind::Descent => {
                let ahead = heading(30.0);
                let high = at(0.0, center - ahead * (0.45 * side), top + 0.6 * side, 30.0, 40.0);
                let low = at(SECONDS, center - ahead * (0.1 * side), top + 0.02 * side, 30.0, 40.0);
                vec![high, low]
            }
            PathKind::Grazing => flight(75.0, SLOW, top + (4.0 * cell).max(3.0), 2.0),
            PathKind::Random => {
                interpolation = Interpolation::Smooth;
                random_walk(stage, seed)
                    .map(|(time, place, height, a, e)| at(time, place, height, a, e))
                    .collect()
            }
        };
        let path = CameraPath::new(keyframes, Projection::default(), DEFAULT_FPS, interpolation)?;
        Ok(path.named(self.name()))
    }
}

/// East and north of a step of length 1.
fn heading(azimuth: f64) -> DVec2 {
    let (sin, cos) = azimuth.to_radians().sin_cos();
    DVec2::new(sin, cos)
}

/// Time, place, height, azimuth and elevation, second by second.
fn random_walk(stage: &PathStage, seed: u64) -> impl Iterator<Item = (f64, DVec2, f64, f64, f64)> {
    let PathStage { center, ground, top, side, .. } = *stage;
    let top = top.max(ground);
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let mut within = move |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
    let (mut place, mut azimuth) = (DVec2::ZERO, within(0.0, 360.0));
    let (mut height, mut elevation) = (within(0.1, 0.25), within(15.0, 40.0));
    (0..=SECONDS as u32).map(move |second| {
        let now = (f64::from(second), center + place * side, top + height * side, azimuth, elevation);
        // Sides of the window a second.
        place += heading(azimuth) * within(0.01, 0.04);
        let home = (-place.x).atan2(-place.y).to_degrees();
        let off = (home - azimuth + 180.0).rem_euclid(360.0) - 180.0;
        // Far out the way leads back, the shorter way round.
        let pull = off * ((place.length() - 0.2) / 0.3).clamp(0.0, 0.5);
        azimuth += within(-35.0, 35.0) + pull;
        height = (height + within(-0.04, 0.04)).clamp(0.06, 0.3);
        elevation = (elevation + within(-8.0, 8.0)).clamp(10.0, 45.0);
        now
    })
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use glam::DVec3;

    pub(in super::super) const STAGE: PathStage = PathStage {
        center: DVec2::new(512_000.3, 5_403_000.7),
        ground: 210.0,
        top: 262.5,
        cell: 0.5,
        side: 2048.0,
    };

    fn eyes(path: &CameraPath) -> Vec<DVec3> {
        (0..path.frames()).map(|frame| path.camera(frame).unwrap().eye()).collect()
    }

    #[test]
    fn benchmark_paths_are_the_same_every_time() {
        for kind in PathKind::ALL {
            let path = kind.path(&STAGE, 1).unwrap();
            assert_eq!(path, kind.path(&STAGE, 1).unwrap());
            assert_eq!((path.frames(), path.name()), (1200, Some(kind.name())));
            for frame in 0..1200 {
                let camera = path.camera(frame).unwrap();
                assert_eq!(camera, path.camera(frame).unwrap());
                assert!(camera.eye().z > STAGE.top, "{kind:?} {frame}: {}", camera.eye());
            }
            let eyes = eyes(&path);
            let steps = eyes.windows(2).map(|w| (w[1] - w[0]).length());
            let (least, most) = steps.fold((f64::INFINITY, 0f64), |(a, b), s| (a.min(s), b.max(s)));
            match kind {
                PathKind::Rest | PathKind::Turn => assert_eq!(most, 0.0),
                PathKind::Slow | PathKind::Grazing => assert!(least > 0.166 && most < 0.167),
                PathKind::Fast | PathKind::Descent => assert!(most - least < 1e-5),
                PathKind::Random => {
                    assert!(least > 0.0 && most < 0.002 * STAGE.side, "{least} {most}");
                    let out = eyes.iter().map(|e| (e.truncate() - STAGE.center).length()).fold(0.0, f64::max);
                    assert!(out < 0.5 * STAGE.side, "{out}");
                }
            }
        }
        let random = |seed| PathKind::Random.path(&STAGE, seed).unwrap();
        assert_ne!(random(1), random(2));
        for seed in 0..50 {
            assert!(eyes(&random(seed)).iter().all(|e| e.z > STAGE.top), "seed {seed}");
        }
        let turn = PathKind::Turn.path(&STAGE, 0).unwrap();
        let [a, b] = [0, 1199].map(|frame| turn.camera(frame).unwrap().angles()[0]);
        assert_eq!((a, (b * 10.0).round()), (0.0, 3597.0));
    }

    #[test]
    fn fast_goes_a_section_a_frame() {
        for cell in [0.25, 0.5, 1.0, 2.0, 0.1, 0.3] {
            let path = PathKind::Fast.path(&PathStage { cell, ..STAGE }, 0).unwrap();
            for pair in eyes(&path).windows(2) {
                let [a, b] = [pair[0], pair[1]].map(|eye| (eye.truncate() / cell).floor());
                assert_eq!(b - a, DVec2::new(256.0, 0.0), "cells of {cell}");
                // Far less than the lattice on which rays start.
                assert!((pair[1].x - pair[0].x - 256.0 * cell).abs() < 1e-9, "cells of {cell}");
            }
        }
    }
}
