//! Coordinates of one system in another: the `proj-core` crate's operations, and what makes them fast enough for points.
//!
//! An operation costs some 0.5 µs a point, ten times what else is done with a point of an uncompressed file. Within a
//! kilometre projections are smooth to less than a micrometre, so that plane coordinates go through **patches**: squares of
//! a lattice in the source system, each with the biquadratic polynomial through nine points of the operation. A patch
//! that is not within a tenth of a millimetre of the operation between those points (at a border of a grid of shifts, at a
//! pole) is not used. What a point comes to depends on its coordinates alone.

use super::system::System;
use glam::{DVec2, DVec3};
use proj_core::{
    AreaOfInterest, Coord, Coord3D, CoordinateOperationMetadata, SelectionOptions, Transform,
    operation_candidates_between_with_selection_options,
};
use std::collections::HashMap;
use std::sync::{Arc, PoisonError, RwLock};

/// Side of a patch in the unit of the source: about a kilometre.
const PATCH_METRES: f64 = 1024.0;
/// Likewise in degrees: 870 m of latitude.
const PATCH_DEGREES: f64 = 1.0 / 128.0;
/// Farthest that a patch may be from the operation, metres.
const PATCH_ERROR: f64 = 1e-4;
/// Patches that are kept, some 25 MB, of 50,000 to 130,000 square kilometres; then all of them are made again.
const MOST_PATCHES: usize = 1 << 17;
/// Intervals on a side of a box whose border is followed: eight points between the corners.
const INTERVALS: usize = 9;

/// Coordinates of one system in another.
pub struct Reprojection {
    transform: Transform,
    /// Unit of the source in degrees where it is geographic, in metres where it is geocentric, else 1; likewise 1 / that
    /// of the target.
    scale: [f64; 2],
    /// A side counts from the Earth's centre: Z takes part, in metres.
    is_spatial: bool,
    /// What Z is multiplied with behind a spatial operation.
    scale_up: f64,
    /// Side of a patch, units of the source.
    patch: f64,
    /// Tolerance of a patch, units of the target.
    tolerance: f64,
    patches: RwLock<HashMap<[i32; 2], Option<Arc<Patch>>>>,
    /// The operation's name, as the register has it.
    pub operation: String,
    /// Its stated accuracy, metres; 0 where the datum stays.
    pub accuracy: Option<f64>,
    /// One of the datums is not named, or no operation between them is known: they are taken for one.
    pub assumes_datum: bool,
}

/// A biquadratic polynomial over a square: coefficients of u^i · v^j at 3 · j + i, u and v from 0 to 1.
struct Patch {
    coefficients: [DVec2; 9],
}

impl std::fmt::Debug for Reprojection {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.debug_struct("Reprojection")
            .field("operation", &self.operation)
            .field("accuracy", &self.accuracy)
            .finish_non_exhaustive()
    }
}

impl Reprojection {
    /// From one system to another. `near`: a point in the middle of the data, by which the operation is chosen.
    /// Errors: why there is no way, in words.
    pub fn between(from: &System, to: &System, near: DVec3) -> Result<Reprojection, String> {
        let is_linear = |system: &System| !system.is_geographic() && !system.is_geocentric();
        let unit = |system: &System| if is_linear(system) { 1.0 } else { system.unit() };
        let scale = [unit(from), 1.0 / unit(to)];
        let is_spatial = from.is_geocentric() || to.is_geocentric();
        let make = |from: &System, to: &System| {
            let (Some(source), Some(target)) = (from.definition(), to.definition()) else {
                return Err("a system is not supported".to_owned());
            };
            let mut options = SelectionOptions::new().with_wgs84_pivot();
            if near.is_finite() && !is_spatial {
                let point = Coord::new(near.x * scale[0], near.y * scale[0]);
                options = options.with_area_of_interest(AreaOfInterest::source_crs_point(point));
            }
            if let Some(operation) = from.own_operation(to) {
                options = options.with_coordinate_operation(operation);
            }
            let chosen = Transform::from_crs_defs_with_selection_options(&source, &target, options.clone())
                .map_err(|error| error.to_string())?;
            if is_named_after_its_ends(chosen.selected_operation()) {
                return Ok(chosen);
            }
            // The library's register has operations between other systems than they are of.
            let others = operation_candidates_between_with_selection_options(&source, &target, &options);
            let others = others.into_iter().flatten().filter(is_named_after_its_ends);
            let with = |id| {
                let options = options.clone().with_operation(id);
                Transform::from_crs_defs_with_selection_options(&source, &target, options).ok()
            };
            Ok(others.filter_map(|operation| operation.id).find_map(with).unwrap_or(chosen))
        };
        // A datum that is not named is the other's, where it may be. Between two that lie on GRS 80 or WGS 84 no shift is
        // better than leaving the file out.
        let may_be_one = from.may_be_on_datum_of(to);
        let on_one = || {
            let [from, to] = from.on_one_datum(to);
            make(&from, &to)
        };
        let (transform, assumes_datum) = match may_be_one {
            true => (on_one()?, true),
            false => match make(from, to) {
                Ok(transform) => (transform, false),
                Err(why) if from.is_near(to) => (on_one().map_err(|_| why)?, true),
                Err(why) => return Err(why),
            },
        };
        let operation = transform.selected_operation();
        // The library takes systems that all lie on GRS 80 without a shift to WGS 84 for one, which may be a metre or two.
        let is_null = operation.id.is_none() && operation.accuracy.is_some_and(|a| a.meters == 0.0);
        let assumes_datum = assumes_datum || is_null && !from.is_on_datum_of(to);
        // What was assumed has no accuracy.
        let accuracy = operation.accuracy.filter(|_| !assumes_datum).map(|accuracy| accuracy.meters);
        let patch = match from.is_geographic() {
            true => PATCH_DEGREES / from.unit(),
            false => (PATCH_METRES / from.unit()).log2().floor().exp2(),
        };
        Ok(Reprojection {
            scale,
            is_spatial,
            patch,
            tolerance: match to.is_geographic() {
                true => PATCH_ERROR / 111_320.0 / to.unit(),
                false => PATCH_ERROR / to.unit(),
            },
            patches: RwLock::default(),
            operation: operation.name.clone(),
            accuracy,
            scale_up: if to.is_geocentric() { scale[1] } else { 1.0 },
            assumes_datum,
            transform,
        })
    }

    /// Both systems are on one datum.
    pub fn keeps_datum(&self) -> bool {
        self.accuracy == Some(0.0)
    }

    /// Z takes part, in metres on both sides.
    pub fn is_spatial(&self) -> bool {
        self.is_spatial
    }

    /// By the operation itself; NaN where it has no result.
    fn exactly(&self, x: f64, y: f64) -> DVec2 {
        match self.transform.convert(Coord::new(x * self.scale[0], y * self.scale[0])) {
            Ok(at) => DVec2::new(at.x * self.scale[1], at.y * self.scale[1]),
            Err(_) => DVec2::NAN,
        }
    }

    fn spatially(&self, p: DVec3) -> DVec3 {
        match self.transform.convert_3d(Coord3D::new(p.x * self.scale[0], p.y * self.scale[0], p.z)) {
            Ok(at) => DVec3::new(at.x * self.scale[1], at.y * self.scale[1], at.z * self.scale_up),
            Err(_) => DVec3::NAN,
        }
    }

    /// A point; NaN where there is none in the other system. Z stays but for geocentric systems.
    pub fn point(&self, p: DVec3) -> DVec3 {
        if self.is_spatial {
            return self.spatially(p);
        }
        let mut last = Last::default();
        self.planar(&mut last, p.x, p.y).extend(p.z)
    }

    /// [`Reprojection::point`] of many, axis by axis.
    pub fn points(&self, x: &mut [f64], y: &mut [f64], z: &mut [f64]) {
        let mut last = Last::default();
        for ((x, y), z) in x.iter_mut().zip(y).zip(z) {
            if self.is_spatial {
                (*x, *y, *z) = self.spatially(DVec3::new(*x, *y, *z)).into();
            } else {
                (*x, *y) = self.planar(&mut last, *x, *y).into();
            }
        }
    }

    fn planar(&self, last: &mut Last, x: f64, y: f64) -> DVec2 {
        let [u, v] = [x, y].map(|value| value / self.patch);
        let [i, j] = [u.floor(), v.floor()];
        // NaN fails.
        if !(i.abs() < 1e9 && j.abs() < 1e9) {
            return DVec2::NAN;
        }
        let key = [i as i32, j as i32];
        if last.key != Some(key) {
            *last = Last { key: Some(key), patch: self.patch_at(key) };
        }
        match &last.patch {
            Some(patch) => patch.at(u - i, v - j),
            None => self.exactly(x, y),
        }
    }

    fn patch_at(&self, key: [i32; 2]) -> Option<Arc<Patch>> {
        let known = self.patches.read().unwrap_or_else(PoisonError::into_inner);
        if let Some(patch) = known.get(&key) {
            return patch.clone();
        }
        drop(known);
        let patch = self.make_patch(key).map(Arc::new);
        let mut known = self.patches.write().unwrap_or_else(PoisonError::into_inner);
        if known.len() >= MOST_PATCHES {
            // Not the operation instead: what a point comes to must not depend on what was read before.
            known.clear();
        }
        known.entry(key).or_insert(patch).clone()
    }

    fn make_patch(&self, [i, j]: [i32; 2]) -> Option<Patch> {
        let at =
            |u: f64, v: f64| self.exactly((f64::from(i) + u) * self.patch, (f64::from(j) + v) * self.patch);
        let patch = Patch::through(at)?;
        let within = |u: f64, v: f64| (patch.at(u, v) - at(u, v)).abs().max_element() <= self.tolerance;
        // Between the points, where the error is largest; NaN fails.
        let checked = [(0.2, 0.2), (0.8, 0.3), (0.25, 0.8), (0.75, 0.75)];
        checked.into_iter().all(|(u, v)| within(u, v)).then_some(patch)
    }

    /// A box around what a box of the source comes to; `None` where that is not known, as between a geocentric system and
    /// another: then all of a file is looked at.
    pub fn bounds(&self, min: DVec3, max: DVec3) -> Option<[DVec3; 2]> {
        if self.is_spatial || !(min.is_finite() && max.is_finite()) {
            return None;
        }
        // The border of a region is around what is in it. It is followed at eight points a side, and widened by what a
        // smooth curve may rise between them: an eighth of the second difference, four times over.
        let corner = |k: usize| match k % 4 {
            0 => min.truncate(),
            1 => DVec2::new(max.x, min.y),
            2 => max.truncate(),
            _ => DVec2::new(min.x, max.y),
        };
        let (mut low, mut high, mut margin) = (DVec2::INFINITY, DVec2::NEG_INFINITY, DVec2::ZERO);
        let mut last = Last::default();
        for side in 0..4 {
            let mut points = [DVec2::NAN; INTERVALS + 1];
            for (k, point) in points.iter_mut().enumerate() {
                let at = corner(side).lerp(corner(side + 1), k as f64 / INTERVALS as f64);
                *point = self.planar(&mut last, at.x, at.y);
                if !point.is_finite() {
                    return None;
                }
                (low, high) = (low.min(*point), high.max(*point));
            }
            for three in points.windows(3) {
                margin = margin.max((three[0] - 2.0 * three[1] + three[2]).abs() / 2.0);
            }
        }
        margin += self.tolerance;
        // A jump, such as at the antimeridian, is no smooth curve.
        if margin.max_element() > 0.25 * (high - low).max_element() + self.tolerance * 4.0 {
            return None;
        }
        Some([(low - margin).extend(min.z), (high + margin).extend(max.z)])
    }
}

/// Whether an operation that is called "A to B (3)" is one between A and B.
fn is_named_after_its_ends(operation: &CoordinateOperationMetadata) -> bool {
    let plain = |name: &str| -> String {
        name.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
    };
    let name_of = |code: Option<u32>| code.and_then(proj_core::lookup_epsg).map(|crs| plain(crs.name()));
    let name = operation.name.trim_end_matches(|c: char| c.is_ascii_digit() || c == ')');
    let ends = name.trim_end_matches('(').split_once(" to ").map(|(a, b)| [plain(a), plain(b)]);
    let (Some([a, b]), Some(from), Some(to)) =
        (ends, name_of(operation.source_crs_epsg), name_of(operation.target_crs_epsg))
    else {
        return true;
    };
    (a == from && b == to) || (a == to && b == from)
}

/// The patch of the point before: neighbours in a file are neighbours on the ground.
#[derive(Default)]
struct Last {
    key: Option<[i32; 2]>,
    patch: Option<Arc<Patch>>,
}

impl Patch {
    /// Through the values at 0, ½ and 1; `None` if one is not finite.
    fn through(value: impl Fn(f64, f64) -> DVec2) -> Option<Patch> {
        let mut coefficients = [DVec2::ZERO; 9];
        for (j, row) in coefficients.chunks_exact_mut(3).enumerate() {
            let v = j as f64 / 2.0;
            row.copy_from_slice(&quadratic([value(0.0, v), value(0.5, v), value(1.0, v)]));
        }
        for i in 0..3 {
            let column = quadratic([coefficients[i], coefficients[3 + i], coefficients[6 + i]]);
            (0..3).for_each(|j| coefficients[3 * j + i] = column[j]);
        }
        coefficients.iter().all(|c| c.is_finite()).then_some(Patch { coefficients })
    }

    #[inline]
    fn at(&self, u: f64, v: f64) -> DVec2 {
        let c = &self.coefficients;
        let row = |j: usize| c[j] + (c[j + 1] + c[j + 2] * u) * u;
        row(0) + (row(3) + row(6) * v) * v
    }
}

/// Coefficients of the parabola through values at 0, ½ and 1.
fn quadratic([a, b, c]: [DVec2; 3]) -> [DVec2; 3] {
    [a, 4.0 * b - 3.0 * a - c, 2.0 * (a + c) - 4.0 * b]
}

#[cfg(test)]
mod tests {
    use super::super::crs::definition;
    use super::*;
    use proptest::prelude::*;

    fn system(code: u16) -> System {
        definition(code).unwrap().system.unwrap()
    }

    fn way(from: u16, to: u16, near: [f64; 2]) -> Reprojection {
        Reprojection::between(&system(from), &system(to), DVec3::new(near[0], near[1], 0.0)).unwrap()
    }

    /// The same points by PROJ 9.1.1 (`cs2cs -f %.4f`).
    #[test]
    fn points_come_to_where_proj_has_them() {
        let cases = [
            (25832, 25833, [500_000.0, 5_500_000.0], [67_034.940_3, 5_517_306.740_4]),
            (25833, 25832, [67_034.940_3, 5_517_306.740_4], [500_000.0, 5_500_000.0]),
        ];
        for (from, to, at, expected) in cases {
            let p = way(from, to, at).point(DVec3::new(at[0], at[1], 12.5));
            assert!(
                (p.truncate() - DVec2::from(expected)).length() < 1e-3 && p.z == 12.5,
                "{from} {to}: {p}"
            );
        }
    }

    /// The register of the library leads "NAD83(HARN) to NAD83(NSRS2007)" to WGS 84.
    #[test]
    fn an_operation_leads_where_its_name_says() {
        let way = way(2994, 32610, [640_000.0, 850_000.0]);
        assert!(way.operation.starts_with("NAD83(HARN) to WGS 84"), "{}", way.operation);
        assert!(way.accuracy.unwrap() >= 1.0);
    }

    /// Systems that all lie on GRS 80 are of several datums.
    #[test]
    fn a_shift_that_is_not_known_is_said_to_be_assumed() {
        let between = |from, to, at| way(from, to, at);
        let assumed = between(26917, 25832, [5e5, 4e6]);
        assert!(assumed.assumes_datum && !assumed.keeps_datum() && assumed.accuracy.is_none());
        let kept = between(25833, 25832, [5e5, 5.5e6]);
        assert!(kept.keeps_datum() && !kept.assumes_datum);
    }

    #[test]
    fn what_has_no_place_is_nowhere_and_the_rest_goes_on() {
        let way = way(4326, 32632, [9.0, 48.0]);
        let (mut x, mut y, mut z) =
            ([9.0, 9.0, f64::NAN, 9.1], [48.0, 97.0, 1.0, 48.0], [1.0, 2.0, 3.0, 4.0]);
        way.points(&mut x, &mut y, &mut z);
        assert!(x[1].is_nan() && x[2].is_nan() && y[1].is_nan());
        assert!((x[0] - 5e5).abs() < 1e-4 && x[3] > x[0] && z == [1.0, 2.0, 3.0, 4.0]);
    }

    #[test]
    fn geocentric_points_bring_their_height() {
        let way = way(4978, 25832, [0.0; 2]);
        // 48.137° N, 11.575° E, 520 m above the ellipsoid.
        let (sin, cos) = 48.137f64.to_radians().sin_cos();
        let (sin_lon, cos_lon) = 11.575f64.to_radians().sin_cos();
        let (a, e2) = (6_378_137.0, 0.006_694_379_990_141_3);
        let n = a / (1.0f64 - e2 * sin * sin).sqrt();
        let p = way.point(DVec3::new(
            (n + 520.0) * cos * cos_lon,
            (n + 520.0) * cos * sin_lon,
            (n * (1.0 - e2) + 520.0) * sin,
        ));
        assert!(way.is_spatial() && (p.z - 520.0).abs() < 0.01, "{p}");
        assert!((p.x - 691_600.0).abs() < 500.0 && (p.y - 5_334_700.0).abs() < 500.0, "{p}");
    }

    #[test]
    fn without_an_operation_there_is_a_reason() {
        assert!(Reprojection::between(&system(31467), &system(25832), DVec3::new(3.5e6, 5.5e6, 0.0)).is_ok());
        let text = r#"PROJCS["x",GEOGCS["x",DATUM["x",SPHEROID["x",6377397.155,299.1528128]],PRIMEM["Greenwich",0],
            UNIT["degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],PARAMETER["central_meridian",9],
            PARAMETER["scale_factor",1],PARAMETER["false_easting",3500000],UNIT["metre",1]]"#;
        let unnamed = super::super::crs::from_wkt(text).unwrap().system.unwrap();
        let why = Reprojection::between(&unnamed, &system(25832), DVec3::new(3.5e6, 5.5e6, 0.0));
        assert!(why.is_err(), "{why:?}");
    }

    proptest! {
        /// Of any box that survey tiles have, and of any point in it.
        #[test]
        fn boxes_hold_their_points(
            pair in prop::sample::select(vec![
                (25833u16, 25832u16), (2154, 32631), (4326, 25832), (31467, 25832), (3857, 25832), (2056, 32632),
            ]),
            (west, south) in (7.0f64..8.5, 47.2f64..49.0),
            (width, height) in (1.0f64..100_000.0, 1.0f64..100_000.0),
            inside in prop::collection::vec((0.0f64..=1.0, 0.0f64..=1.0), 1..40),
        ) {
            let (from, to) = pair;
            let corner = way(4326, from, [west, south]).point(DVec3::new(west, south, 0.0));
            let unit = if from == 4326 { 1.0 / 111_000.0 } else { 1.0 };
            let size = DVec3::new(width, height, 0.0) * unit;
            let way = way(from, to, [corner.x, corner.y]);
            let Some([low, high]) = way.bounds(corner, corner + size) else {
                return Err(TestCaseError::fail("no box"));
            };
            for (u, v) in inside {
                let p = corner + size * DVec3::new(u, v, 0.0);
                let exact = way.exactly(p.x, p.y);
                let fast = way.point(p).truncate();
                prop_assert!((exact - fast).length() < 2e-4, "{exact} {fast}");
                for p in [exact, fast] {
                    prop_assert!(p.cmpge(low.truncate()).all() && p.cmple(high.truncate()).all(), "{low} {p} {high}");
                }
            }
            // Not much wider than need be: the corners span it but for the turn of the axes.
            let corners = [way.point(corner), way.point(corner + size)];
            let spanned = (corners[1] - corners[0]).truncate().abs() + 1.0;
            let turned = (high - low).truncate();
            prop_assert!(turned.x < spanned.x + spanned.y && turned.y < spanned.x + spanned.y, "{turned} {spanned}");
        }
    }
}
