//! How a file's coordinates become world coordinates: as they are, from degrees, from geocentric ones,
//! heights in another unit; and which files share one world.

use super::crs::{Crs, CrsKind, Unit};
use glam::{DMat3, DVec3};

/// From file coordinates (X · scale + offset) to world E, N, U.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Placement {
    /// World coordinates are the file's, bit for bit.
    #[default]
    AsIs,
    /// Each axis times its factor: degrees to metres, heights to the horizontal unit.
    Scaled(DVec3),
    /// Geocentric: turned to east, north, up at `origin`.
    Turned {
        /// Geocentric coordinates of E = N = U = 0.
        origin: DVec3,
        /// Geocentric to east, north, up.
        turn: DMat3,
    },
}

impl Placement {
    /// World coordinates of a point in file coordinates.
    #[inline]
    pub fn place(&self, x: f64, y: f64, z: f64) -> DVec3 {
        let point = DVec3::new(x, y, z);
        match self {
            Placement::AsIs => point,
            Placement::Scaled(factor) => point * *factor,
            Placement::Turned { origin, turn } => *turn * (point - *origin),
        }
    }

    /// File coordinates of a world point: what a pick reports.
    pub fn unplace(&self, world: DVec3) -> DVec3 {
        match self {
            Placement::AsIs => world,
            Placement::Scaled(factor) => world / *factor,
            Placement::Turned { origin, turn } => turn.transpose() * world + *origin,
        }
    }

    /// Whether [`Placement::place`] changes nothing.
    pub fn is_identity(&self) -> bool {
        *self == Placement::AsIs
    }

    fn scaled(factor: DVec3) -> Placement {
        if factor == DVec3::ONE { Placement::AsIs } else { Placement::Scaled(factor) }
    }
}

/// What [`World::of`] must know of a file.
#[derive(Clone, Copy, Debug)]
pub struct FileFacts<'a> {
    /// As read from the file.
    pub crs: Option<&'a Crs>,
    /// Points in the file.
    pub points: u64,
    /// A point in the middle of the file, file coordinates: a median, so that stray points do not
    /// matter. Not finite where there are no points.
    pub centre: DVec3,
}

/// What the user may decide otherwise.
#[derive(Clone, Debug, Default)]
pub struct PlacementOptions {
    /// Draw every file in its raw coordinates.
    pub mix_crs: bool,
    /// Unit of Z, whatever the files say.
    pub z_unit: Option<Unit>,
    /// The world of files that are open already, to which these come.
    pub known: Option<KnownWorld>,
}

/// A world that was decided on.
#[derive(Clone, Debug)]
pub struct KnownWorld {
    /// Its coordinate system.
    pub crs: Option<Crs>,
    /// Unit of E, N, U.
    pub unit: Option<Unit>,
    /// How files get there, but for the unit of their heights.
    pub base: Placement,
}

/// The one coordinate system that is drawn, and how each file gets there.
#[derive(Clone, Debug, Default)]
pub struct World {
    /// The majority's; `None` where no file names one, or where raw coordinates are mixed.
    pub crs: Option<Crs>,
    /// Unit of E, N, U; `None` where nothing says it.
    pub unit: Option<Unit>,
    /// How files get there, but for the unit of their heights.
    pub base: Placement,
    /// One a file; `None`: left out.
    pub placements: Vec<Option<Placement>>,
    /// What the user should know.
    pub notes: Vec<PlacementNote>,
}

/// A thing that was decided and is not obvious. `file`: index into the files.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlacementNote {
    /// Another coordinate system than most files have.
    #[error(
        "left out: its coordinate system is {found}, most files have {world} (--mix-crs draws raw coordinates)"
    )]
    LeftOut {
        /// Which.
        file: usize,
        /// Its system.
        found: String,
        /// The majority's.
        world: String,
    },
    /// No coordinate system, while others have one.
    #[error("{world} is assumed for {} that {} no coordinate system", count(*files), if *files == 1 { "names" } else { "name" })]
    Assumed {
        /// How many.
        files: usize,
        /// The majority's.
        world: String,
    },
    /// Degrees drawn in metres.
    #[error("degrees are drawn in metres, scaled at latitude {latitude}°")]
    Degrees {
        /// Centre latitude rounded to 1°.
        latitude: f64,
    },
    /// Said to be degrees, but cannot be.
    #[error("says {name}, but its coordinates ({x:.1}, {y:.1}) are no degrees: drawn as they are")]
    NotDegrees {
        /// The system's name.
        name: String,
        /// First coordinate.
        x: f64,
        /// Second coordinate.
        y: f64,
    },
    /// Said to be geocentric, but cannot be.
    #[error(
        "says {name}, but its points are {radius_km:.0} km from the Earth's centre, not 6,330 to 6,400: drawn as they are"
    )]
    NotGeocentric {
        /// The system's name.
        name: String,
        /// Distance from the centre of the Earth.
        radius_km: f64,
    },
    /// Heights in another unit than E and N.
    #[error("heights are in {from}, shown in {to} ({})", count(*files), from = from.name, to = to.name)]
    HeightUnit {
        /// In the files.
        from: Unit,
        /// In the world.
        to: Unit,
        /// How many files.
        files: usize,
    },
}

fn count(files: usize) -> String {
    if files == 1 { "1 file".into() } else { format!("{files} files") }
}

impl PlacementNote {
    /// The file that the note is about, if it is about one.
    pub fn file(&self) -> Option<usize> {
        match self {
            PlacementNote::LeftOut { file, .. } => Some(*file),
            _ => None,
        }
    }
}

/// Two units closer than this are drawn as one: feet and US survey feet (2e-6 apart, 2 mm in 1 km of
/// height) are mixed freely in practice, and untouched heights stay exact.
const SAME_UNIT: f64 = 1e-5;

impl World {
    /// Decides for all files at once. The result does not depend on their order but for ties.
    pub fn of(files: &[FileFacts], options: &PlacementOptions) -> World {
        if options.mix_crs {
            let placement = |file: &FileFacts| {
                let unit = file.crs.map_or_else(Unit::metre, |crs| crs.horizontal_unit.clone());
                let up = options.z_unit.as_ref().map_or(1.0, |z| up_factor(z, &unit));
                Some(Placement::scaled(DVec3::new(1.0, 1.0, up)))
            };
            let placements = files.iter().map(placement).collect();
            return World { placements, ..World::default() };
        }
        let mut world = World::default();
        let majority = match &options.known {
            Some(known) => known.crs.as_ref(),
            None => majority(files),
        };
        let is_plane = |crs: &Crs| matches!(crs.kind, CrsKind::Projected | CrsKind::Unknown);
        let is_member = |file: &FileFacts| match (majority, file.crs) {
            (Some(majority), Some(crs)) => majority.same_horizontal(crs),
            // Metres or feet on a plane may be taken for the neighbours'; angles may not.
            (Some(majority), None) => is_plane(majority),
            // The same the other way round: files that name none are open already.
            (None, Some(crs)) => options.known.is_some() && is_plane(crs),
            (None, None) => true,
        };
        let name = |crs: Option<&Crs>| crs.map_or("none that is named".to_owned(), |crs| crs.name.clone());
        for (index, file) in files.iter().enumerate() {
            if !is_member(file) && file.points > 0 {
                let (found, world_name) = (name(file.crs), name(majority));
                world.notes.push(PlacementNote::LeftOut { file: index, found, world: world_name });
            }
        }
        let assumed = files.iter().filter(|file| file.crs.is_none() && majority.is_some() && is_member(file));
        match assumed.count() {
            0 => {}
            files => world.notes.push(PlacementNote::Assumed { files, world: name(majority) }),
        }
        world.crs = majority.cloned();
        (world.base, world.unit) = match &options.known {
            Some(known) => (known.base, known.unit.clone()),
            None => {
                let members = files.iter().filter(|file| is_member(file));
                base_and_unit(majority, median(members.map(|file| file.centre)), &mut world.notes)
            }
        };
        let base = world.base;
        let horizontal = world.unit.clone().unwrap_or_else(Unit::metre);
        let mut heights: Vec<(Unit, usize)> = Vec::new();
        for file in files {
            let placement = is_member(file).then(|| match base {
                Placement::Turned { .. } => base,
                _ => {
                    let crs = file.crs.or(majority);
                    let stated = options.z_unit.as_ref().or(crs.and_then(|crs| crs.vertical_unit.as_ref()));
                    let up = stated.map_or(1.0, |unit| up_factor(unit, &horizontal));
                    if let Some(unit) = stated.filter(|_| up != 1.0) {
                        match heights.iter_mut().find(|(known, _)| known == unit) {
                            Some((_, count)) => *count += 1,
                            None => heights.push((unit.clone(), 1)),
                        }
                    }
                    match base {
                        Placement::Scaled(factor) => Placement::scaled(factor.with_z(up)),
                        _ => Placement::scaled(DVec3::new(1.0, 1.0, up)),
                    }
                }
            });
            world.placements.push(placement);
        }
        for (from, files) in heights {
            world.notes.push(PlacementNote::HeightUnit { from, to: horizontal.clone(), files });
        }
        world
    }
}

/// How files of a system are drawn, and the unit that they then have.
fn base_and_unit(
    crs: Option<&Crs>,
    centre: DVec3,
    notes: &mut Vec<PlacementNote>,
) -> (Placement, Option<Unit>) {
    let Some(crs) = crs else { return (Placement::AsIs, None) };
    let base = match crs.kind {
        CrsKind::Geographic | CrsKind::Geocentric => base_of_angles(crs, centre, notes),
        _ => Placement::AsIs,
    };
    // Degrees become metres; where they turn out to be none, the unit is anybody's guess.
    let unit = match (crs.kind, base) {
        (CrsKind::Geographic, Placement::AsIs) => None,
        (CrsKind::Geographic, _) => Some(Unit::metre()),
        _ => Some(crs.horizontal_unit.clone()),
    };
    (base, unit)
}

fn up_factor(z: &Unit, horizontal: &Unit) -> f64 {
    let ratio = z.si / horizontal.si;
    if (ratio - 1.0).abs() < SAME_UNIT { 1.0 } else { ratio }
}

/// The system that most files have; of equals the one with more points, then the first by name. Files
/// that name none are no vote, unless the others' coordinates are angles.
fn majority<'a>(files: &[FileFacts<'a>]) -> Option<&'a Crs> {
    let mut groups: Vec<(&Crs, usize, u64)> = Vec::new();
    for file in files.iter().filter(|file| file.points > 0) {
        let Some(crs) = file.crs else { continue };
        match groups.iter_mut().find(|group| group.0.same_horizontal(crs)) {
            Some(group) => {
                group.1 += 1;
                group.2 = group.2.saturating_add(file.points);
            }
            None => groups.push((crs, 1, file.points)),
        }
    }
    let best = groups.into_iter().max_by(|a, b| (a.1, a.2, &b.0.name).cmp(&(b.1, b.2, &a.0.name)))?;
    let unnamed = files.iter().filter(|file| file.crs.is_none() && file.points > 0).count();
    let angles = matches!(best.0.kind, CrsKind::Geographic | CrsKind::Geocentric);
    (!angles || best.1 >= unnamed).then_some(best.0)
}

/// The middle of the finite ones, each axis by itself.
fn median(points: impl Iterator<Item = DVec3>) -> DVec3 {
    let points: Vec<DVec3> = points.filter(|point| point.is_finite()).collect();
    let axis = |axis: usize| {
        let mut values: Vec<f64> = points.iter().map(|point| point[axis]).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
    };
    DVec3::new(axis(0), axis(1), axis(2))
}

/// The placement that a geographic or geocentric system asks for, if the coordinates bear it out.
fn base_of_angles(crs: &Crs, centre: DVec3, notes: &mut Vec<PlacementNote>) -> Placement {
    if !centre.is_finite() {
        return Placement::AsIs;
    }
    let (name, si) = (crs.name.clone(), crs.horizontal_unit.si);
    if crs.kind == CrsKind::Geographic {
        let degrees = centre * si.to_degrees();
        if degrees.x.abs() > 360.0 || degrees.y.abs() > 90.0 {
            notes.push(PlacementNote::NotDegrees { name, x: centre.x, y: centre.y });
            return Placement::AsIs;
        }
        // At the pole itself a degree of longitude has no length.
        let latitude = degrees.y.round().clamp(-89.0, 89.0);
        notes.push(PlacementNote::Degrees { latitude });
        let [east, north] = metres_per_degree(latitude);
        let per_unit = si.to_degrees();
        return Placement::Scaled(DVec3::new(east * per_unit, north * per_unit, 1.0));
    }
    let radius_km = centre.length() * si / 1000.0;
    if !(6330.0..=6400.0).contains(&radius_km) {
        notes.push(PlacementNote::NotGeocentric { name, radius_km });
        return Placement::AsIs;
    }
    // Rounded to 0.01° (about 1 km), so that tiles drawn by themselves share one grid, while the plane
    // is tilted by no more than that against the true horizontal.
    let (latitude, longitude) = geodetic(centre * si);
    let step = |angle: f64| (angle.to_degrees() * 100.0).round() / 100.0;
    let (latitude, longitude) = (step(latitude).to_radians(), step(longitude).to_radians());
    let ((sin_lat, cos_lat), (sin_lon, cos_lon)) = (latitude.sin_cos(), longitude.sin_cos());
    let normal = A / (1.0 - E2 * sin_lat * sin_lat).sqrt();
    let origin =
        DVec3::new(normal * cos_lat * cos_lon, normal * cos_lat * sin_lon, normal * (1.0 - E2) * sin_lat)
            / si;
    let turn = DMat3::from_cols(
        DVec3::new(-sin_lon, cos_lon, 0.0),
        DVec3::new(-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat),
        DVec3::new(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat),
    )
    .transpose();
    Placement::Turned { origin, turn }
}

/// WGS 84: equatorial radius in metres and squared eccentricity. Other ellipsoids differ by 1e-5 at most.
const A: f64 = 6_378_137.0;
const E2: f64 = 0.006_694_379_990_141_316;

/// Length of one degree of longitude and of latitude on the WGS 84 ellipsoid, metres.
/// Source: Snyder 1987 (USGS PP 1395), 4-18 and 4-20.
pub fn metres_per_degree(latitude: f64) -> [f64; 2] {
    let (sin, cos) = latitude.to_radians().sin_cos();
    let w = 1.0 - E2 * sin * sin;
    let prime_vertical = A / w.sqrt();
    let meridian = A * (1.0 - E2) / (w * w.sqrt());
    [(prime_vertical * cos).to_radians(), meridian.to_radians()]
}

/// Latitude and longitude, radians, of a geocentric point in metres (Bowring 1976: good to 1e-9 rad near
/// the ground).
fn geodetic(point: DVec3) -> (f64, f64) {
    let b = A * (1.0 - E2).sqrt();
    let across = point.x.hypot(point.y);
    let (sin, cos) = (point.z * A).atan2(across * b).sin_cos();
    let second = E2 / (1.0 - E2);
    let latitude = (point.z + second * b * sin.powi(3)).atan2(across - E2 * A * cos.powi(3));
    (latitude, point.y.atan2(point.x))
}

#[cfg(test)]
mod tests {
    use super::super::crs::definition;
    use super::*;

    fn facts(crs: Option<&Crs>, centre: [f64; 3]) -> FileFacts<'_> {
        FileFacts { crs, points: 10, centre: DVec3::from(centre) }
    }

    fn only(crs: &Crs, centre: [f64; 3]) -> (Placement, World) {
        let world = World::of(&[facts(Some(crs), centre)], &PlacementOptions::default());
        (world.placements[0].unwrap(), world)
    }

    #[test]
    fn projected_coordinates_are_bit_exact() {
        let utm = definition(32632).unwrap();
        let (placement, world) = only(&utm, [5e5, 6e6, 100.0]);
        assert!(placement.is_identity() && world.notes.is_empty());
        assert_eq!(world.unit, Some(Unit::metre()));
        let x = f64::from(12_345_678) * 0.001 + 500_000.1;
        assert_eq!(placement.place(x, -x, x).x.to_bits(), x.to_bits());
    }

    #[test]
    fn a_degree_is_as_long_as_the_tables_say() {
        // Snyder 1987, table 4 (lengths of one degree) and its formulas at the equator.
        for (latitude, east, north) in [(0.0, 111_319.5, 110_574.3), (45.0, 78_846.8, 111_131.8)] {
            let [e, n] = metres_per_degree(latitude);
            assert!((e - east).abs() < 0.5 && (n - north).abs() < 0.5, "{latitude}: {e} {n}");
        }
    }

    #[test]
    fn degrees_are_scaled_at_the_rounded_latitude() {
        let wgs84 = definition(4326).unwrap();
        let (placement, world) = only(&wgs84, [-123.07, 44.056, 130.0]);
        assert_eq!(world.notes, [PlacementNote::Degrees { latitude: 44.0 }]);
        let [east, north] = metres_per_degree(44.0);
        let world_point = placement.place(-123.0, 44.0, 130.0);
        assert!((world_point - DVec3::new(-123.0 * east, 44.0 * north, 130.0)).length() < 1e-6);
        assert!((placement.unplace(world_point) - DVec3::new(-123.0, 44.0, 130.0)).length() < 1e-12);
        let (placement, world) = only(&wgs84, [637_000.0, 4_800_000.0, 1.0]);
        assert!(placement.is_identity() && world.unit.is_none());
        assert!(matches!(world.notes[..], [PlacementNote::NotDegrees { .. }]));
    }

    #[test]
    fn geocentric_points_stand_upright() {
        let geocentric = definition(4978).unwrap();
        // 48.137° N, 11.575° E, 520 m above the ellipsoid, by the closed formula.
        let ecef = |latitude: f64, longitude: f64, height: f64| {
            let ((s, c), (sl, cl)) = (latitude.to_radians().sin_cos(), longitude.to_radians().sin_cos());
            let n = A / (1.0 - E2 * s * s).sqrt();
            DVec3::new((n + height) * c * cl, (n + height) * c * sl, (n * (1.0 - E2) + height) * s)
        };
        let ground = ecef(48.137, 11.575, 520.0);
        let (placement, world) = only(&geocentric, ground.to_array());
        assert!(matches!(placement, Placement::Turned { .. }) && world.notes.is_empty());
        let place = |p: DVec3| placement.place(p.x, p.y, p.z);
        let roof = ecef(48.137, 11.575, 530.0);
        let up = place(roof) - place(ground);
        assert!((up - DVec3::new(0.0, 0.0, 10.0)).length() < 0.002, "{up}");
        let north = place(ecef(48.138, 11.575, 520.0)) - place(ground);
        assert!((north.y - 111.2).abs() < 0.1 && north.x.abs() < 0.1 && north.z.abs() < 0.1, "{north}");
        assert!((place(ground).z - 520.0).abs() < 1.0);
        assert!((placement.unplace(place(ground)) - ground).length() < 1e-6);
    }

    #[test]
    fn a_system_that_lies_is_drawn_as_it_is() {
        let geocentric = definition(4978).unwrap();
        let (placement, world) = only(&geocentric, [515_380.0, 4_918_340.0, 2_322.0]);
        assert!(placement.is_identity());
        let text = world.notes[0].to_string();
        assert!(text.contains("4945 km"), "{text}");
    }

    #[test]
    fn heights_in_another_unit() {
        let mut crs = definition(26912).unwrap();
        crs.vertical_unit = Some("us-ft".parse().unwrap());
        let (placement, world) = only(&crs, [5e5, 4e6, 3000.0]);
        assert_eq!(placement.place(5e5, 4e6, 3937.0), DVec3::new(5e5, 4e6, 1200.0));
        assert!(world.notes[0].to_string().contains("US survey foot, shown in metre"));
        let options = PlacementOptions { z_unit: Some(Unit::metre()), ..Default::default() };
        let world = World::of(&[facts(Some(&crs), [0.0; 3])], &options);
        assert!(world.placements[0].unwrap().is_identity());
        // Feet of either kind are one unit.
        let mut feet = definition(2992).unwrap();
        feet.vertical_unit = Some("us-ft".parse().unwrap());
        assert!(only(&feet, [6e5, 8e5, 400.0]).0.is_identity());
    }

    #[test]
    fn more_files_come_to_a_known_world() {
        let [utm, lambert, wgs84] = [32632, 2154, 4326].map(|code| definition(code).unwrap());
        let come_to = |files: &[FileFacts], known: World| {
            let known = KnownWorld { crs: known.crs, unit: known.unit, base: known.base };
            World::of(files, &PlacementOptions { known: Some(known), ..Default::default() })
        };
        let of = |crs, at| World::of(&[facts(crs, at)], &PlacementOptions::default());
        let here = [5e5, 5e6, 0.0];
        // Whatever most of them have.
        let files = [
            facts(Some(&lambert), here),
            facts(Some(&lambert), here),
            facts(None, here),
            facts(Some(&utm), here),
        ];
        let world = come_to(&files, of(Some(&utm), here));
        let drawn: Vec<bool> = world.placements.iter().map(Option::is_some).collect();
        assert_eq!(drawn, [false, false, true, true]);
        assert_eq!(world.crs.unwrap().epsg, Some(32632));
        // Beside files that name none, what lies on a plane is taken for theirs.
        let files = [facts(Some(&utm), here), facts(Some(&wgs84), [9.0, 48.0, 0.0]), facts(None, here)];
        let world = come_to(&files, of(None, here));
        let drawn: Vec<bool> = world.placements.iter().map(Option::is_some).collect();
        assert_eq!((drawn, world.crs.is_none()), (vec![true, false, true], true));
        // Degrees are as long as those that are there.
        let first = of(Some(&wgs84), [9.0, 48.0, 0.0]);
        let placement = first.placements[0];
        let world = come_to(&[facts(Some(&wgs84), [9.0, 58.0, 0.0])], first);
        assert_eq!((world.placements[0], world.unit), (placement, Some(Unit::metre())));
    }

    #[test]
    fn the_majority_decides() {
        let (utm, lambert, wgs84) =
            (definition(32632).unwrap(), definition(2154).unwrap(), definition(4326).unwrap());
        let files = [
            facts(Some(&lambert), [7e5, 6e6, 0.0]),
            facts(Some(&utm), [5e5, 5e6, 0.0]),
            facts(None, [5e5, 5e6, 0.0]),
            facts(Some(&utm), [5e5, 5e6, 0.0]),
            facts(Some(&wgs84), [9.0, 48.0, 0.0]),
        ];
        let world = World::of(&files, &PlacementOptions::default());
        let drawn: Vec<bool> = world.placements.iter().map(Option::is_some).collect();
        assert_eq!(drawn, [false, true, true, true, false]);
        assert_eq!(world.crs.unwrap().epsg, Some(32632));
        let about: Vec<_> = world.notes.iter().map(|note| note.file()).collect();
        assert_eq!(about, [Some(0), Some(4), None]);
        assert!(matches!(world.notes[2], PlacementNote::Assumed { files: 1, .. }));
        let mixed = World::of(&files, &PlacementOptions { mix_crs: true, ..Default::default() });
        assert!(mixed.placements.iter().all(|placement| placement.unwrap().is_identity()));

        let files = [facts(None, [1.0; 3]), facts(None, [1.0; 3]), facts(Some(&wgs84), [9.0, 48.0, 0.0])];
        let world = World::of(&files, &PlacementOptions::default());
        assert_eq!(world.placements.iter().map(Option::is_some).collect::<Vec<_>>(), [true, true, false]);
    }
}
