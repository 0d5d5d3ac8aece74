//! How a file's coordinates become world coordinates: as they are, from degrees, from geocentric ones,
//! heights in another unit; and which files share one world.

use super::crs::{Crs, CrsKind, Unit};
use super::reproject::Reprojection;
use super::system::System;
use glam::{DMat3, DVec3};
use std::path::Path;
use std::sync::Arc;

/// From coordinates of the world's system to E, N, U as they are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Fit {
    /// They are the same, bit for bit.
    #[default]
    AsIs,
    /// Each axis times its factor: degrees to metres, stretched metres to those of the ground, heights to the horizontal
    /// unit.
    Scaled(DVec3),
    /// Geocentric: turned to east, north, up at `origin`.
    Turned {
        /// Geocentric coordinates of E = N = U = 0.
        origin: DVec3,
        /// Geocentric to east, north, up.
        turn: DMat3,
    },
}

impl Fit {
    fn scaled(factor: DVec3) -> Fit {
        if factor == DVec3::ONE { Fit::AsIs } else { Fit::Scaled(factor) }
    }

    /// E, N, U of a point in the world's system.
    #[inline]
    pub fn place(&self, point: DVec3) -> DVec3 {
        match self {
            Fit::AsIs => point,
            Fit::Scaled(factor) => point * *factor,
            Fit::Turned { origin, turn } => *turn * (point - *origin),
        }
    }

    /// Coordinates in the world's system of a place: what a pick reports.
    pub fn unplace(&self, world: DVec3) -> DVec3 {
        match self {
            Fit::AsIs => world,
            Fit::Scaled(factor) => world / *factor,
            Fit::Turned { origin, turn } => turn.transpose() * world + *origin,
        }
    }

    /// Whether the world's coordinates are drawn as they are.
    pub fn is_identity(&self) -> bool {
        *self == Fit::AsIs
    }

    /// Factors of E and N, where axes stay axes.
    pub fn horizontal_scale(&self) -> Option<[f64; 2]> {
        match self {
            Fit::AsIs => Some([1.0; 2]),
            Fit::Scaled(factor) => Some([factor.x, factor.y]),
            Fit::Turned { .. } => None,
        }
    }

    /// A box around what a box comes to.
    fn bounds(&self, [low, high]: [DVec3; 2]) -> [DVec3; 2] {
        let corner = |k: usize| {
            let pick = |bit: usize, a: f64, b: f64| if k & bit == 0 { a } else { b };
            let corner = DVec3::new(pick(1, low.x, high.x), pick(2, low.y, high.y), pick(4, low.z, high.z));
            self.place(corner)
        };
        let first = corner(0);
        (1..8).map(corner).fold([first; 2], |[low, high], at| [low.min(at), high.max(at)])
    }
}

/// From file coordinates (X · scale + offset) to E, N, U: through the operation between the systems where the file's is
/// another one than the world's, then as the world is drawn.
#[derive(Clone, Debug, Default)]
pub struct Placement {
    /// Another system than the world's, and what Z is multiplied with before: metres, where it takes part.
    through: Option<(Arc<Reprojection>, f64)>,
    fit: Fit,
}

impl PartialEq for Placement {
    fn eq(&self, other: &Placement) -> bool {
        let same_way = match (&self.through, &other.through) {
            (None, None) => true,
            (Some((a, z)), Some((b, of_other))) => Arc::ptr_eq(a, b) && z == of_other,
            _ => false,
        };
        same_way && self.fit == other.fit
    }
}

impl From<Fit> for Placement {
    fn from(fit: Fit) -> Placement {
        Placement { through: None, fit }
    }
}

impl Placement {
    /// World coordinates of a point in file coordinates; NaN where it has none.
    #[inline]
    pub fn place(&self, x: f64, y: f64, z: f64) -> DVec3 {
        let point = DVec3::new(x, y, z);
        match &self.through {
            None => self.fit.place(point),
            Some((through, up)) => self.fit.place(through.point(point.with_z(z * up))),
        }
    }

    /// [`Placement::place`] of many points, axis by axis.
    pub fn place_many(&self, x: &mut [f64], y: &mut [f64], z: &mut [f64]) {
        if let Some((through, up)) = &self.through {
            if *up != 1.0 {
                z.iter_mut().for_each(|z| *z *= up);
            }
            through.points(x, y, z);
        }
        match self.fit {
            Fit::AsIs => {}
            Fit::Scaled(factor) => {
                x.iter_mut().for_each(|x| *x *= factor.x);
                y.iter_mut().for_each(|y| *y *= factor.y);
                z.iter_mut().for_each(|z| *z *= factor.z);
            }
            Fit::Turned { .. } => {
                for ((x, y), z) in x.iter_mut().zip(y).zip(z) {
                    (*x, *y, *z) = self.fit.place(DVec3::new(*x, *y, *z)).into();
                }
            }
        }
    }

    /// World box around what a box of file coordinates comes to; `None` where that is not known.
    pub fn bounds(&self, min: DVec3, max: DVec3) -> Option<[DVec3; 2]> {
        let through = match &self.through {
            None => [min, max],
            Some((through, up)) => through.bounds(min.with_z(min.z * up), max.with_z(max.z * up))?,
        };
        Some(self.fit.bounds(through))
    }

    /// Whether [`Placement::place`] changes nothing.
    pub fn is_identity(&self) -> bool {
        self.through.is_none() && self.fit.is_identity()
    }

    /// Whether the file's system is another one than the world's.
    pub fn is_transformed(&self) -> bool {
        self.through.is_some()
    }

    /// Whether boxes stay about as large: their axes are not turned.
    pub fn keeps_axes(&self) -> bool {
        !matches!(self.fit, Fit::Turned { .. })
    }
}

/// What [`World::of`] must know of a file.
#[derive(Clone, Copy, Debug)]
pub struct FileFacts<'a> {
    /// Where it lies.
    pub path: &'a Path,
    /// As read from the file.
    pub crs: Option<&'a Crs>,
    /// Points in the file.
    pub points: u64,
    /// A point in the middle of the file, file coordinates: a median, so that stray points do not
    /// matter. Not finite where there are no points.
    pub centre: DVec3,
    /// How far its points spread about that, without strays.
    pub extent: DVec3,
    /// Step of X and Y.
    pub step: f64,
}

/// A system that files are taken to be in: those whose name fits the pattern, whatever they say; without a pattern those
/// that name none, or one that their coordinates cannot be of.
#[derive(Clone, Debug)]
pub struct Assumption {
    /// Of file names.
    pub pattern: Option<glob::Pattern>,
    /// The system.
    pub crs: Crs,
}

/// What the user may decide otherwise.
#[derive(Clone, Debug, Default)]
pub struct PlacementOptions {
    /// Draw every file in its raw coordinates.
    pub mix_crs: bool,
    /// Unit of Z, whatever the files say.
    pub z_unit: Option<Unit>,
    /// The world's system.
    pub crs: Option<Crs>,
    /// Systems of files; of those that fit the last one counts.
    pub assume: Vec<Assumption>,
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
    /// How the system is drawn.
    pub base: Fit,
    /// The ways into it that files took.
    pub operations: Operations,
}

/// The one coordinate system that is drawn, and how each file gets there.
#[derive(Clone, Debug, Default)]
pub struct World {
    /// The user's choice, or the majority's, projected where any is; `None` where no file names one, or where raw
    /// coordinates are mixed.
    pub crs: Option<Crs>,
    /// Unit of E, N, U; `None` where nothing says it.
    pub unit: Option<Unit>,
    /// How the system is drawn: what eyes, picks and paths go through.
    pub base: Fit,
    /// The ways into it that files took.
    pub operations: Operations,
    /// One a file; `None`: left out.
    pub placements: Vec<Option<Placement>>,
    /// One a file: what was done with its coordinates.
    pub treatments: Vec<Treatment>,
    /// What the user should know.
    pub notes: Vec<PlacementNote>,
}

/// What was done with the coordinates of a file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Treatment {
    /// They are of the world's system, or no file names one.
    #[default]
    Placed,
    /// The file names no system: they are taken to be of the world's.
    Assumed {
        /// The world's.
        world: String,
    },
    /// The file names a system, and those of the world name none: they are taken as they are.
    Unmatched {
        /// The file's.
        from: String,
    },
    /// They are transformed.
    Transformed {
        /// The file's system.
        from: String,
        /// The world's.
        to: String,
        /// How, and how exactly.
        how: String,
    },
    /// They cannot be placed in the world.
    LeftOut {
        /// Why.
        why: String,
    },
}

impl Treatment {
    /// Of a file that goes into the world by an operation.
    fn transformed(from: &Crs, to: Option<&Crs>, through: &Reprojection) -> Treatment {
        let accuracy = through.accuracy.filter(|m| *m > 0.0).map_or(String::new(), |m| format!(", to {m} m"));
        let how = format!("{}{accuracy}", operation_name(through));
        let to = to.map_or(String::new(), |crs| crs.name.clone());
        Treatment::Transformed { from: from.name.clone(), to, how }
    }
}

/// How an operation is called.
fn operation_name(through: &Reprojection) -> String {
    match through.assumes_datum {
        true => "one datum taken for the other".to_owned(),
        false if through.keeps_datum() => "on the same datum".to_owned(),
        false => through.operation.clone(),
    }
}

/// A thing that was decided and is not obvious. `file`: index into the files.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlacementNote {
    /// Another coordinate system, and no way from it into the world's.
    #[error(
        "left out: its coordinate system is {found}, the picture's is {world}, and {why} (--mix-crs draws raw coordinates)"
    )]
    LeftOut {
        /// Which.
        file: usize,
        /// Its system.
        found: String,
        /// The world's.
        world: String,
        /// Why it cannot be transformed.
        why: String,
    },
    /// Another system, transformed.
    #[error(
        "{} in {from} {} transformed into {to} ({operation}{})",
        count(*files),
        if *files == 1 { "is" } else { "are" },
        accuracy.map_or(String::new(), |m| if m > 0.0 { format!(", to {m} m") } else { String::new() })
    )]
    Transformed {
        /// How many.
        files: usize,
        /// Their system.
        from: String,
        /// The world's.
        to: String,
        /// How.
        operation: String,
        /// Stated accuracy, metres.
        accuracy: Option<f64>,
    },
    /// No coordinate system, while others have one.
    #[error("{world} is assumed for {} that {} no coordinate system", count(*files), if *files == 1 { "names" } else { "name" })]
    Assumed {
        /// How many.
        files: usize,
        /// The majority's.
        world: String,
    },
    /// The user knows better than the files.
    #[error("{} {} another coordinate system than {crs}, which is taken for theirs as asked", count(*files), if *files == 1 { "names" } else { "name" })]
    Overruled {
        /// How many.
        files: usize,
        /// What they are taken to be in.
        crs: String,
    },
    /// A pattern that the user gave.
    #[error("--assume-crs {0}: fits no input's name")]
    NoFit(String),
    /// Degrees or geocentric coordinates that are not called so.
    #[error(
        "{} that {} no coordinate system {} {what} (--assume-crs names another one)",
        count(*files),
        if *files == 1 { "names" } else { "name" },
        if *files == 1 { "has coordinates that can only be" } else { "have coordinates that can only be" }
    )]
    Recognised {
        /// How many.
        files: usize,
        /// As what.
        what: &'static str,
    },
    /// Degrees drawn in metres.
    #[error("degrees are drawn in metres, scaled at latitude {latitude}°")]
    Degrees {
        /// Centre latitude rounded to 1°.
        latitude: f64,
    },
    /// A projection that stretches is drawn at its true scale.
    #[error("{name} stretches lengths {factor:.2} times at latitude {latitude}°: drawn at true scale")]
    Stretched {
        /// The system's name.
        name: String,
        /// Its metres in one of the ground.
        factor: f64,
        /// Centre latitude rounded to 1°.
        latitude: f64,
    },
    /// Said to be degrees, but cannot be.
    #[error("says {name}, but its coordinates ({x:.1}, {y:.1}) are no degrees: taken as naming none")]
    NotDegrees {
        /// Which.
        file: usize,
        /// The system's name.
        name: String,
        /// First coordinate.
        x: f64,
        /// Second coordinate.
        y: f64,
    },
    /// Said to be geocentric, but cannot be.
    #[error(
        "says {name}, but its points are {radius_km:.0} km from the Earth's centre, not 6,330 to 6,400, or near the equator's plane: taken as naming none"
    )]
    NotGeocentric {
        /// Which.
        file: usize,
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
    /// Heights that count from different surfaces.
    #[error("heights count from different surfaces, and are drawn as they are: {}", .0.join("; "))]
    VerticalSystems(Vec<String>),
}

fn count(files: usize) -> String {
    if files == 1 { "1 file".into() } else { format!("{files} files") }
}

impl PlacementNote {
    /// The file that the note is about, if it is about one.
    pub fn file(&self) -> Option<usize> {
        match self {
            PlacementNote::LeftOut { file, .. }
            | PlacementNote::NotDegrees { file, .. }
            | PlacementNote::NotGeocentric { file, .. } => Some(*file),
            _ => None,
        }
    }
}

/// Two units closer than this are drawn as one: feet and US survey feet (2e-6 apart, 2 mm in 1 km of
/// height) are mixed freely in practice, and untouched heights stay exact.
const SAME_UNIT: f64 = 1e-5;

/// Coordinates within these, and heights that range over more than so many times the rest, are degrees.
const MOST_LONGITUDE: f64 = 360.0;
const MOST_LATITUDE: f64 = 90.0;
const TALL: f64 = 200.0;
/// And steps of at most so much: a metre on the ground. What is measured in metres is kept in coarser ones.
const ANGLE_STEP: f64 = 1e-5;
/// Distance from the Earth's centre, km, and least distance from the plane of the equator, m: UTM coordinates may be as
/// far from 0, 0, 0, but their heights are small.
const EARTH_KM: std::ops::RangeInclusive<f64> = 6330.0..=6400.0;
const LEAST_Z: f64 = 100_000.0;

/// What a file's coordinates are taken to be.
struct Taken<'a> {
    crs: Option<std::borrow::Cow<'a, Crs>>,
    /// Unit of length of a system that it named and cannot have.
    unit: Option<Unit>,
}

impl World {
    /// Decides for all files at once. The result does not depend on their order but for ties.
    pub fn of(files: &[FileFacts], options: &PlacementOptions) -> World {
        if options.mix_crs {
            let placement = |file: &FileFacts| {
                let unit = file.crs.map_or_else(Unit::metre, |crs| crs.horizontal_unit.clone());
                let up = options.z_unit.as_ref().map_or(1.0, |z| up_factor(z, &unit));
                Some(Fit::scaled(DVec3::new(1.0, 1.0, up)).into())
            };
            let placements = files.iter().map(placement).collect();
            let treatments = vec![Treatment::Placed; files.len()];
            return World { placements, treatments, ..World::default() };
        }
        let mut world = World::default();
        let taken = taken(files, options, &mut world.notes);
        // What files that name none are taken to be in.
        let majority = match &options.known {
            Some(known) => known.crs.as_ref(),
            None => majority(files, &taken),
        };
        world.crs = match &options.known {
            Some(known) => known.crs.clone(),
            None => options.crs.clone().or_else(|| majority.cloned()),
        };
        let ways = ways(files, &taken, majority, options, &mut world);
        (world.base, world.unit) = match &options.known {
            Some(known) => (known.base, known.unit.clone()),
            None => {
                // The middle of what is drawn, in the world's system.
                let centre = median(files.iter().zip(&ways).filter_map(|(file, way)| match way {
                    Way::LeftOut => None,
                    Way::Member => Some(file.centre),
                    Way::Through(through) => Some(through.point(file.centre)),
                }));
                let unit = taken.iter().find_map(|taken| taken.unit.clone());
                let (base, own) = base_and_unit(world.crs.as_ref(), centre, &mut world.notes);
                (base, own.or(unit.filter(|_| world.crs.is_none())))
            }
        };
        let horizontal = world.unit.clone().unwrap_or_else(Unit::metre);
        let metre = Unit::metre();
        let mut heights: Vec<(Unit, usize)> = Vec::new();
        for ((file, taken), way) in files.iter().zip(&taken).zip(ways) {
            let through = match way {
                Way::LeftOut => {
                    world.placements.push(None);
                    continue;
                }
                Way::Member => None,
                Way::Through(through) => Some(through),
            };
            let crs = taken.crs.as_deref().or(majority);
            let stated = options.z_unit.as_ref().or(crs.and_then(|crs| crs.vertical_unit.as_ref()));
            // Where nothing is said, heights are in the unit of E and N, or in metres beside angles.
            let usual = match crs {
                Some(crs) if crs.kind != CrsKind::Geographic => &crs.horizontal_unit,
                _ => &metre,
            };
            let unit = stated.or(Some(usual).filter(|_| through.is_some()));
            let up = unit.map_or(1.0, |unit| up_factor(unit, &horizontal));
            if let Some(unit) = unit.filter(|_| up != 1.0 && file.points > 0) {
                match heights.iter_mut().find(|(known, _)| known == unit) {
                    Some((_, count)) => *count += 1,
                    None => heights.push((unit.clone(), 1)),
                }
            }
            let placement = match (through, world.base) {
                (None, Fit::Turned { .. }) => world.base.into(),
                (through, base) => {
                    let [x, y] = base.horizontal_scale().unwrap_or([1.0; 2]);
                    match through {
                        Some(through) if through.is_spatial() => {
                            let metres = match taken.crs.as_deref().map(|crs| crs.kind) {
                                Some(CrsKind::Geocentric) => crs.map_or(1.0, |crs| crs.horizontal_unit.si),
                                _ => unit.map_or(1.0, |unit| unit.si),
                            };
                            let fit = match base {
                                Fit::Turned { .. } => base,
                                _ => Fit::scaled(DVec3::new(x, y, up_factor(&Unit::metre(), &horizontal))),
                            };
                            Placement { through: Some((through, metres)), fit }
                        }
                        through => Placement {
                            through: through.map(|through| (through, 1.0)),
                            fit: Fit::scaled(DVec3::new(x, y, up)),
                        },
                    }
                }
            };
            world.placements.push(Some(placement));
        }
        for (from, files) in heights {
            world.notes.push(PlacementNote::HeightUnit { from, to: horizontal.clone(), files });
        }
        vertical_systems(&taken, &mut world);
        world
    }
}

/// How a file gets into the world's system.
enum Way {
    /// It is in it.
    Member,
    Through(Arc<Reprojection>),
    LeftOut,
}

/// What each file is taken to be in: what it says, unless the user or its own coordinates say otherwise.
fn taken<'a>(
    files: &[FileFacts<'a>],
    options: &'a PlacementOptions,
    notes: &mut Vec<PlacementNote>,
) -> Vec<Taken<'a>> {
    use std::borrow::Cow;
    let mut overruled: Vec<(&Crs, usize)> = Vec::new();
    let mut recognised = [0; 2];
    let mut taken = Vec::with_capacity(files.len());
    for (index, file) in files.iter().enumerate() {
        let name = file.path.file_name().unwrap_or_default().to_string_lossy();
        let fits = |assumption: &&Assumption| {
            assumption
                .pattern
                .as_ref()
                .is_some_and(|pattern| pattern.matches(&name) || pattern.matches_path(file.path))
        };
        if let Some(assumption) = options.assume.iter().rev().find(fits) {
            if file.crs.is_some_and(|crs| !crs.same_horizontal(&assumption.crs)) {
                match overruled.iter_mut().find(|(crs, _)| std::ptr::eq(*crs, &assumption.crs)) {
                    Some((_, count)) => *count += 1,
                    None => overruled.push((&assumption.crs, 1)),
                }
            }
            taken.push(Taken { crs: Some(Cow::Borrowed(&assumption.crs)), unit: None });
            continue;
        }
        let note = file.crs.and_then(|crs| contradiction(index, file, crs));
        let (crs, unit) = match (&note, file.crs) {
            (None, Some(crs)) => (Some(Cow::Borrowed(crs)), None),
            (Some(PlacementNote::NotGeocentric { .. }), Some(crs)) => {
                (None, Some(crs.horizontal_unit.clone()))
            }
            _ => (None, None),
        };
        notes.extend(note);
        let default = || {
            let plain = options.assume.iter().rev().find(|assumption| assumption.pattern.is_none());
            plain.map(|assumption| Cow::Borrowed(&assumption.crs))
        };
        let seen = || {
            let geocentric = recognise(file)?;
            recognised[usize::from(geocentric)] += 1;
            Some(Cow::Owned(Crs::recognised(geocentric)))
        };
        let crs = crs.or_else(default).or_else(seen);
        taken.push(Taken { crs, unit });
    }
    if options.known.is_none() {
        for pattern in options.assume.iter().filter_map(|assumption| assumption.pattern.as_ref()) {
            let fits = |file: &FileFacts| {
                let name = file.path.file_name().unwrap_or_default().to_string_lossy();
                pattern.matches(&name) || pattern.matches_path(file.path)
            };
            if !files.iter().any(fits) {
                notes.push(PlacementNote::NoFit(pattern.to_string()));
            }
        }
    }
    for (crs, files) in overruled {
        notes.push(PlacementNote::Overruled { files, crs: crs.name.clone() });
    }
    let words = ["longitude and latitude in degrees", "geocentric X, Y, Z"];
    for (files, what) in recognised.into_iter().zip(words).filter(|(files, _)| *files > 0) {
        notes.push(PlacementNote::Recognised { files, what });
    }
    taken
}

/// What is wrong where a file's coordinates cannot be of the system that it names.
fn contradiction(index: usize, file: &FileFacts, crs: &Crs) -> Option<PlacementNote> {
    let (centre, name, si) = (file.centre, crs.name.clone(), crs.horizontal_unit.si);
    if !centre.is_finite() {
        return None;
    }
    match crs.kind {
        CrsKind::Geographic => {
            let degrees = centre * si.to_degrees();
            let fits = degrees.x.abs() <= MOST_LONGITUDE && degrees.y.abs() <= MOST_LATITUDE;
            (!fits).then_some(PlacementNote::NotDegrees { file: index, name, x: centre.x, y: centre.y })
        }
        CrsKind::Geocentric => {
            let radius_km = centre.length() * si / 1000.0;
            let fits = EARTH_KM.contains(&radius_km) && (centre.z * si).abs() > LEAST_Z;
            (!fits).then_some(PlacementNote::NotGeocentric { file: index, name, radius_km })
        }
        _ => None,
    }
}

/// Whether coordinates that nothing is said of leave no doubt: `Some(true)` for geocentric ones, `Some(false)` for
/// degrees.
fn recognise(file: &FileFacts) -> Option<bool> {
    let FileFacts { centre, extent, points, .. } = *file;
    if points == 0 || !centre.is_finite() {
        return None;
    }
    if EARTH_KM.contains(&(centre.length() / 1000.0)) && centre.z.abs() > LEAST_Z {
        return Some(true);
    }
    let across = extent.x.max(extent.y);
    let fits = centre.x.abs() <= MOST_LONGITUDE && centre.y.abs() <= MOST_LATITUDE;
    // A mast stands on some ground: without an extent nothing is sure.
    let is_tall = across > 0.0 && extent.z > TALL * across;
    (fits && is_tall && file.step <= ANGLE_STEP).then_some(false)
}

/// The operations from systems into the world's: one for all files of a system, whenever they come, so that tiles fit
/// together.
pub type Operations = Vec<(System, Arc<Reprojection>)>;

/// A file's system: what it is taken to be in, or the others'. What names no datum is that of files which name one and are
/// the same but for that; of several the one with the most points.
fn own_system(taken: &Taken, named: &[(&Crs, u64)], others: Option<&Crs>) -> Option<Crs> {
    let own = taken.crs.as_deref().or(others)?;
    let is_open = own.system.is_some_and(|system| !system.names_its_datum());
    let fitting = named.iter().filter(|(crs, _)| is_open && crs.same_horizontal(own));
    let named = fitting.max_by(|a, b| (a.1, &b.0.name).cmp(&(b.1, &a.0.name)));
    Some(match named {
        // The file's own words of heights stay.
        Some((crs, _)) => Crs { system: crs.system, ..own.clone() },
        None => own.clone(),
    })
}

/// How each file gets into the world's system. `of_files`: what they are taken to be in.
fn ways(
    files: &[FileFacts],
    of_files: &[Taken],
    majority: Option<&Crs>,
    options: &PlacementOptions,
    world: &mut World,
) -> Vec<Way> {
    let is_plane = |crs: &Crs| matches!(crs.kind, CrsKind::Projected | CrsKind::Unknown);
    let name = |crs: Option<&Crs>| crs.map_or("none that is named".to_owned(), |crs| crs.name.clone());
    let mut named: Vec<(&Crs, u64)> = Vec::new();
    for (file, taken) in files.iter().zip(of_files) {
        let Some(crs) = taken.crs.as_deref() else { continue };
        if crs.system.is_some_and(|system| system.names_its_datum()) {
            match named.iter_mut().find(|(known, _)| known.same_horizontal(crs)) {
                Some((_, points)) => *points = points.saturating_add(file.points),
                None => named.push((crs, file.points)),
            }
        }
    }
    // Metres or feet on a plane may be taken for the neighbours'; angles may not.
    let others = majority.filter(|crs| is_plane(crs));
    let own: Vec<Option<Crs>> = of_files.iter().map(|taken| own_system(taken, &named, others)).collect();
    // Those that name their datum and those that do not are different things to an operation.
    let is_one = |a: &Crs, b: &Crs| {
        let names = |crs: &Crs| crs.system.is_some_and(|system| system.names_its_datum());
        names(a) == names(b) && a.same_horizontal(b)
    };
    world.operations = options.known.as_ref().map_or_else(Vec::new, |known| known.operations.clone());
    let mut known: Vec<(&Crs, usize, Operation)> = Vec::new();
    let mut assumed = 0;
    let mut ways = Vec::with_capacity(files.len());
    for (index, file) in files.iter().enumerate() {
        let way = match (&own[index], &world.crs) {
            (None, None) => Ok(Way::Member),
            (Some(own), Some(to)) if to.same_horizontal(own) => Ok(Way::Member),
            // Files that name none are open already: what lies on a plane is taken for theirs.
            (Some(own), None) if options.known.is_some() && is_plane(own) => Ok(Way::Member),
            (None, Some(to)) if is_plane(to) => Ok(Way::Member),
            (Some(crs), Some(to)) => {
                let at = known.iter().position(|(other, ..)| is_one(other, crs));
                let at = at.unwrap_or_else(|| {
                    let alike = files.iter().zip(&own).filter_map(|(file, own)| {
                        own.as_ref().filter(|own| is_one(own, crs)).map(|_| file.centre)
                    });
                    let used =
                        world.operations.iter().find(|(system, _)| Some(system) == crs.system.as_ref());
                    let operation = match used {
                        Some((_, through)) => Ok(Arc::clone(through)),
                        None => between(crs, to, median(alike)),
                    };
                    if let (Ok(through), None, Some(system)) = (&operation, used, crs.system) {
                        world.operations.push((system, Arc::clone(through)));
                    }
                    known.push((crs, 0, operation));
                    known.len() - 1
                });
                let (_, count, through) = &mut known[at];
                *count += usize::from(file.points > 0);
                through.clone().map(Way::Through)
            }
            (None, Some(_)) => Err("what names none cannot be placed among angles".to_owned()),
            (Some(_), None) => Err("the other files name none".to_owned()),
        };
        let is_named = of_files[index].crs.is_some();
        world.treatments.push(match (&way, &own[index], &world.crs) {
            (Err(why), ..) => {
                let found = name(own[index].as_ref());
                Treatment::LeftOut { why: format!("its coordinate system is {found}, and {why}") }
            }
            (Ok(Way::Through(through)), Some(own), to) => Treatment::transformed(own, to.as_ref(), through),
            (Ok(_), _, Some(to)) if !is_named => Treatment::Assumed { world: to.name.clone() },
            (Ok(_), Some(own), None) => Treatment::Unmatched { from: own.name.clone() },
            (Ok(_), ..) => Treatment::Placed,
        });
        assumed += usize::from(!is_named && file.points > 0 && way.is_ok() && world.crs.is_some());
        ways.push(way.unwrap_or_else(|why| {
            if file.points > 0 {
                let (found, to) = (name(own[index].as_ref()), name(world.crs.as_ref()));
                world.notes.push(PlacementNote::LeftOut { file: index, found, world: to, why });
            }
            Way::LeftOut
        }));
    }
    if assumed > 0 {
        let assumed_name = name(majority.or(world.crs.as_ref()));
        world.notes.push(PlacementNote::Assumed { files: assumed, world: assumed_name });
    }
    for (crs, files, through) in known {
        let Ok(through) = through else { continue };
        if files == 0 {
            continue;
        }
        let operation = operation_name(&through);
        world.notes.push(PlacementNote::Transformed {
            files,
            from: crs.name.clone(),
            to: name(world.crs.as_ref()),
            operation,
            accuracy: through.accuracy,
        });
    }
    ways
}

/// An operation, or why there is none.
type Operation = Result<Arc<Reprojection>, String>;

/// The operation between two systems. `near`: in the middle of what it is for.
fn between(from: &Crs, to: &Crs, near: DVec3) -> Operation {
    match (&from.system, &to.system) {
        (Some(from), Some(to)) => Reprojection::between(from, to, near).map(Arc::new),
        (None, _) => Err("what its name stands for is not known".to_owned()),
        (_, None) => Err("what the picture's stands for is not known".to_owned()),
    }
}

/// Says where heights of files count from different surfaces.
fn vertical_systems(taken: &[Taken], world: &mut World) {
    let plain = |name: &str| -> String {
        name.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
    };
    let mut named: Vec<(String, &str)> = Vec::new();
    for (taken, placement) in taken.iter().zip(&world.placements) {
        let vertical = taken.crs.as_deref().and_then(|crs| crs.vertical.as_deref());
        if let (Some(vertical), Some(_)) = (vertical, placement)
            && !named.iter().any(|(known, _)| *known == plain(vertical))
        {
            named.push((plain(vertical), vertical));
        }
    }
    if named.len() > 1 {
        let mut names: Vec<String> = named.into_iter().map(|(_, name)| name.to_owned()).collect();
        names.sort();
        world.notes.push(PlacementNote::VerticalSystems(names));
    }
}

/// How a system is drawn, and the unit that it then has. `centre`: of the data, in that system.
fn base_and_unit(crs: Option<&Crs>, centre: DVec3, notes: &mut Vec<PlacementNote>) -> (Fit, Option<Unit>) {
    let Some(crs) = crs else { return (Fit::AsIs, None) };
    let si = crs.horizontal_unit.si;
    match crs.kind {
        // Degrees become metres.
        CrsKind::Geographic => {
            let latitude = centre.y * si.to_degrees();
            // Without a point anything will do; at the pole itself a degree of longitude has no length.
            let latitude = if latitude.is_finite() { latitude.round().clamp(-89.0, 89.0) } else { 0.0 };
            notes.push(PlacementNote::Degrees { latitude });
            let [east, north] = metres_per_degree(latitude);
            let per_unit = si.to_degrees();
            (Fit::Scaled(DVec3::new(east * per_unit, north * per_unit, 1.0)), Some(Unit::metre()))
        }
        CrsKind::Geocentric => (upright(centre, si), Some(crs.horizontal_unit.clone())),
        _ => (true_scale(crs, centre, notes), Some(crs.horizontal_unit.clone())),
    }
}

/// Lengths that a projection stretches by less than this are left alone: maps do.
const STRETCHED: f64 = 1.02;

/// The fit of a projected system: Mercator projections, away from the equator, are drawn at the scale of the ground, or
/// what stands on it would be too low.
fn true_scale(crs: &Crs, centre: DVec3, notes: &mut Vec<PlacementNote>) -> Fit {
    let Some(system) = crs.system.filter(|system| system.ground_scale(0.0).is_some()) else {
        return Fit::AsIs;
    };
    let degrees = Reprojection::between(&system, &System::wgs84(false), centre);
    let Ok(latitude) = degrees.map(|degrees| degrees.point(centre).y.round()) else { return Fit::AsIs };
    let Some([east, north]) = system.ground_scale(latitude.clamp(-89.0, 89.0)) else { return Fit::AsIs };
    let factor = 1.0 / east;
    if !latitude.is_finite() || factor.is_nan() || factor < STRETCHED {
        return Fit::AsIs;
    }
    notes.push(PlacementNote::Stretched { name: crs.name.clone(), factor, latitude });
    Fit::Scaled(DVec3::new(east, north, 1.0))
}

fn up_factor(z: &Unit, horizontal: &Unit) -> f64 {
    let ratio = z.si / horizontal.si;
    if (ratio - 1.0).abs() < SAME_UNIT { 1.0 } else { ratio }
}

/// The system that most files have, projected where any is; of equals the one with more points, then the first by name.
/// Files that name none are no vote, unless the others' coordinates are angles.
fn majority<'a>(files: &[FileFacts], taken: &'a [Taken]) -> Option<&'a Crs> {
    struct Group<'a> {
        crs: &'a Crs,
        is_plane: bool,
        files: usize,
        points: u64,
    }
    let mut groups: Vec<Group> = Vec::new();
    let with_points = || files.iter().zip(taken).filter(|(file, _)| file.points > 0);
    // Systems that say more come first: what names no datum may be of several.
    let says = |crs: &Crs| crs.system.is_some_and(|system| system.names_its_datum());
    for pass in [true, false] {
        for (file, taken) in with_points() {
            let Some(crs) = taken.crs.as_deref().filter(|crs| says(crs) == pass) else { continue };
            let fitting = groups.iter_mut().filter(|group| group.crs.same_horizontal(crs));
            match fitting.max_by_key(|group| group.points) {
                Some(group) => {
                    group.files += 1;
                    group.points = group.points.saturating_add(file.points);
                }
                None => {
                    let is_plane = !matches!(crs.kind, CrsKind::Geographic | CrsKind::Geocentric);
                    groups.push(Group { crs, is_plane, files: 1, points: file.points });
                }
            }
        }
    }
    let best = groups.into_iter().max_by(|a, b| {
        (a.is_plane, a.files, a.points, &b.crs.name).cmp(&(b.is_plane, b.files, b.points, &a.crs.name))
    })?;
    let unnamed = with_points().filter(|(_, taken)| taken.crs.is_none()).count();
    (best.is_plane || best.files >= unnamed).then_some(best.crs)
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

/// Geocentric coordinates about `centre`, a unit of `si` metres, turned so that up is up.
fn upright(centre: DVec3, si: f64) -> Fit {
    if !centre.is_finite() {
        return Fit::AsIs;
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
    Fit::Turned { origin, turn }
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
        let path = Path::new("tile.laz");
        FileFacts {
            path,
            crs,
            points: 10,
            centre: DVec3::from(centre),
            extent: DVec3::new(100.0, 100.0, 10.0),
            step: 0.001,
        }
    }

    fn only(crs: &Crs, centre: [f64; 3]) -> (Placement, World) {
        let world = World::of(&[facts(Some(crs), centre)], &PlacementOptions::default());
        (world.placements[0].clone().unwrap(), world)
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
        assert!((world.base.unplace(world_point) - DVec3::new(-123.0, 44.0, 130.0)).length() < 1e-12);
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
        assert!(matches!(world.base, Fit::Turned { .. }) && world.notes.is_empty());
        let place = |p: DVec3| placement.place(p.x, p.y, p.z);
        let roof = ecef(48.137, 11.575, 530.0);
        let up = place(roof) - place(ground);
        assert!((up - DVec3::new(0.0, 0.0, 10.0)).length() < 0.002, "{up}");
        let north = place(ecef(48.138, 11.575, 520.0)) - place(ground);
        assert!((north.y - 111.2).abs() < 0.1 && north.x.abs() < 0.1 && north.z.abs() < 0.1, "{north}");
        assert!((place(ground).z - 520.0).abs() < 1.0);
        assert!((world.base.unplace(place(ground)) - ground).length() < 1e-6);
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
        assert!(world.placements[0].as_ref().unwrap().is_identity());
        // Feet of either kind are one unit.
        let mut feet = definition(2992).unwrap();
        feet.vertical_unit = Some("us-ft".parse().unwrap());
        assert!(only(&feet, [6e5, 8e5, 400.0]).0.is_identity());
    }

    #[test]
    fn more_files_come_to_a_known_world() {
        let [utm, lambert, wgs84] = [32632, 2154, 4326].map(|code| definition(code).unwrap());
        let come_to = |files: &[FileFacts], known: World| {
            let known = KnownWorld {
                crs: known.crs,
                unit: known.unit,
                base: known.base,
                operations: known.operations,
            };
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
        let transformed = |world: &World| -> Vec<Option<bool>> {
            world.placements.iter().map(|p| p.as_ref().map(Placement::is_transformed)).collect()
        };
        assert_eq!(transformed(&world), [Some(true), Some(true), Some(false), Some(false)]);
        assert_eq!(world.crs.unwrap().epsg, Some(32632));
        // Beside files that name none, what lies on a plane is taken for theirs.
        let files = [facts(Some(&utm), here), facts(Some(&wgs84), [9.0, 48.0, 0.0]), facts(None, here)];
        let world = come_to(&files, of(None, here));
        let drawn: Vec<bool> = world.placements.iter().map(Option::is_some).collect();
        assert_eq!((drawn, world.crs.is_none()), (vec![true, false, true], true));
        // Degrees are as long as those that are there.
        let first = of(Some(&wgs84), [9.0, 48.0, 0.0]);
        let placement = first.placements[0].clone();
        let world = come_to(&[facts(Some(&wgs84), [9.0, 58.0, 0.0])], first);
        assert_eq!((world.placements[0].clone(), world.unit), (placement, Some(Unit::metre())));
    }

    #[test]
    fn worlds_of_another_kind_than_all_files_have_a_middle() {
        let ecef = |latitude: f64, longitude: f64| {
            let ((s, c), (sl, cl)) = (latitude.to_radians().sin_cos(), longitude.to_radians().sin_cos());
            let n = A / (1.0 - E2 * s * s).sqrt();
            [n * c * cl, n * c * sl, n * (1.0 - E2) * s]
        };
        let to = |code, of, at| {
            let (world_crs, of) = (definition(code), definition(of).unwrap());
            let options = PlacementOptions { crs: world_crs, ..Default::default() };
            World::of(&[facts(Some(&of), at)], &options)
        };
        let degrees = to(4326, 4978, ecef(48.0, 9.0));
        assert!(degrees.notes.contains(&PlacementNote::Degrees { latitude: 48.0 }), "{:?}", degrees.notes);
        let mercator = to(3857, 4978, ecef(60.0, 9.0));
        let stretched =
            |note: &PlacementNote| matches!(note, PlacementNote::Stretched { latitude: 60.0, .. });
        assert!(mercator.notes.iter().any(stretched), "{:?}", mercator.notes);
        let upright = to(4978, 25832, [5e5, 5.3e6, 100.0]);
        assert!(matches!(upright.base, Fit::Turned { .. }));
        let at = upright.placements[0].as_ref().unwrap();
        let up = at.place(5e5, 5.3e6, 110.0) - at.place(5e5, 5.3e6, 100.0);
        assert!((up - DVec3::new(0.0, 0.0, 10.0)).length() < 0.01, "{up}");
    }

    #[test]
    fn a_datum_that_is_not_named_is_that_of_files_which_are_the_same_but_for_it() {
        let gda94 = definition(28355).unwrap();
        let mut unnamed = gda94.clone();
        let text = gda94.wkt.as_ref().unwrap().replace("AUTHORITY", "NOTHING");
        unnamed.system =
            super::super::crs::from_wkt(&text.replace("Geocentric_Datum_of_Australia_1994", "x"))
                .unwrap()
                .system;
        assert!(!unnamed.system.unwrap().names_its_datum());
        let options = PlacementOptions { crs: definition(7856), ..Default::default() };
        let at = [5e5, 6.2e6, 0.0];
        for files in [
            [facts(Some(&unnamed), at), facts(Some(&gda94), at)],
            [facts(Some(&gda94), at), facts(Some(&unnamed), at)],
        ] {
            let world = World::of(&files, &options);
            let [a, b] = [0, 1].map(|k| world.placements[k].as_ref().unwrap().place(at[0], at[1], at[2]));
            assert!((a - b).length() < 1e-6, "{a} {b} {:?}", world.notes);
            assert_eq!(world.operations.len(), 1);
        }
        // Files that come later go the same way.
        let first = World::of(&[facts(Some(&gda94), at)], &options);
        let known = KnownWorld {
            crs: first.crs.clone(),
            unit: first.unit.clone(),
            base: first.base,
            operations: first.operations.clone(),
        };
        let far = [6e5, 6.9e6, 0.0];
        let later =
            World::of(&[facts(Some(&gda94), far)], &PlacementOptions { known: Some(known), ..options });
        assert!(Arc::ptr_eq(&later.operations[0].1, &first.operations[0].1));
    }

    #[test]
    fn datums_that_are_not_named_are_guessed_near_wgs_84_alone() {
        let lv95 = definition(2056).unwrap();
        let text = r#"PROJCS["x",GEOGCS["x",DATUM["x",SPHEROID["x",6377397.155,299.1528128]],PRIMEM["Greenwich",0],
            UNIT["degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],PARAMETER["central_meridian",9],
            PARAMETER["scale_factor",1],PARAMETER["false_easting",3500000],UNIT["metre",1]]"#;
        let unnamed = super::super::crs::from_wkt(text).unwrap();
        let options = PlacementOptions { crs: Some(lv95), ..Default::default() };
        let world = World::of(&[facts(Some(&unnamed), [3.5e6, 5.3e6, 0.0])], &options);
        assert!(matches!(world.notes[..], [PlacementNote::LeftOut { file: 0, .. }]), "{:?}", world.notes);
    }

    #[test]
    fn heights_beside_degrees_are_metres_where_nothing_is_said() {
        let (feet, degrees) = (definition(2992).unwrap(), definition(4269).unwrap());
        let files = [facts(Some(&feet), [6e5, 8e5, 400.0]), facts(Some(&degrees), [-123.0, 44.0, 120.0])];
        let world = World::of(&files, &PlacementOptions::default());
        let at = world.placements[1].as_ref().unwrap().place(-123.0, 44.0, 120.0);
        assert!((at.z - 120.0 / 0.3048).abs() < 1e-9, "{at}");
        assert!(world.notes.iter().any(|note| matches!(note, PlacementNote::HeightUnit { files: 1, .. })));
    }

    #[test]
    fn a_mast_is_no_degrees() {
        // 30 m high, 0.1 m wide, about 0, 0; in millimetres.
        let mast = FileFacts { extent: DVec3::new(0.1, 0.1, 30.0), ..facts(None, [0.0, 0.0, 15.0]) };
        assert!(World::of(&[mast], &PlacementOptions::default()).notes.is_empty());
        let degrees = FileFacts { step: 1e-7, extent: DVec3::new(0.01, 0.01, 30.0), ..mast };
        let world = World::of(&[degrees], &PlacementOptions::default());
        assert!(matches!(world.notes[0], PlacementNote::Recognised { files: 1, .. }), "{:?}", world.notes);
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
        let way = |world: &World| -> Vec<Option<bool>> {
            world.placements.iter().map(|p| p.as_ref().map(Placement::is_transformed)).collect()
        };
        let expected = [true, false, false, false, true].map(Some);
        assert_eq!(way(&world), expected);
        assert_eq!(world.crs.as_ref().unwrap().epsg, Some(32632));
        assert!(matches!(world.notes[0], PlacementNote::Assumed { files: 1, .. }), "{:?}", world.notes);
        let transformed = |note: &&PlacementNote| matches!(note, PlacementNote::Transformed { files: 1, .. });
        assert_eq!(world.notes.iter().filter(transformed).count(), 2, "{:?}", world.notes);
        // 9° east is the zone's central meridian.
        let at = world.placements[4].as_ref().unwrap().place(9.0, 48.0, 7.0);
        assert!((at.x - 5e5).abs() < 1e-6 && (5.316e6..5.317e6).contains(&at.y) && at.z == 7.0, "{at}");
        // A system in which a plane cannot be projected is no majority.
        let many = [files[4], files[4], files[4], files[1]];
        assert_eq!(World::of(&many, &PlacementOptions::default()).crs.unwrap().epsg, Some(32632));
        // Or the user's own.
        let lambert_world =
            World::of(&files, &PlacementOptions { crs: Some(lambert.clone()), ..Default::default() });
        let expected = [false, true, true, true, true].map(Some);
        assert_eq!(way(&lambert_world), expected, "{:?}", lambert_world.notes);
        let mixed = World::of(&files, &PlacementOptions { mix_crs: true, ..Default::default() });
        assert!(mixed.placements.iter().flatten().all(Placement::is_identity));
        assert_eq!(mixed.placements.iter().flatten().count(), files.len());

        let files = [facts(None, [1.0; 3]), facts(None, [1.0; 3]), facts(Some(&wgs84), [9.0, 48.0, 0.0])];
        let world = World::of(&files, &PlacementOptions::default());
        assert_eq!(world.placements.iter().map(Option::is_some).collect::<Vec<_>>(), [true, true, false]);
    }
}
