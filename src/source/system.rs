//! What a coordinate system is, whatever it is called: projection, parameters, datum, units. Two systems are the same when
//! these are; names and codes decide only where a definition says nothing else.
//! Source: OGC 01-009, 7; OGC 18-010r7, 8 to 14; EPSG guidance note 7-2 (methods and their parameters).

use super::wkt::Node;
use proj_core::{
    CoordinateOperation, CrsDef, DatumToWgs84, Ellipsoid, GeocentricCrsDef, GeographicCrsDef, HelmertParams,
    LinearUnit, OperationDomain, OperationMethod, ProjectedCrsDef, ProjectionMethod,
};

/// What X, Y, Z are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum CrsKind {
    /// Easting, northing, height.
    Projected,
    /// Longitude, latitude, height.
    Geographic,
    /// Cartesian, from the centre of the Earth.
    Geocentric,
    /// Not said.
    Unknown,
}

/// The horizontal part of a coordinate system, as numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct System {
    form: Form,
    datum: Datum,
    /// One unit of X and Y in metres; in degrees for [`Form::Geographic`].
    unit: f64,
    /// EPSG code that the definition carries. It names the system; it does not decide what it is.
    code: Option<u32>,
}

/// How coordinates come from latitude and longitude.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Form {
    /// They are longitude and latitude.
    Geographic,
    /// Cartesian, from the centre of the Earth.
    Geocentric,
    /// A projection whose parameters are known.
    Projected(Projection),
    /// A projection of the EPSG register, of a method that is not taken apart here.
    Registered(u32),
}

/// Methods that definitions in files are taken apart for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Method {
    TransverseMercator,
    LambertConformalConic,
    AlbersEqualArea,
    PolarStereographic,
    ObliqueStereographic,
    Mercator,
    WebMercator,
    LambertAzimuthalEqualArea,
    CassiniSoldner,
    /// Easting and northing count from the natural origin.
    HotineObliqueMercatorA,
    /// They count from the projection centre.
    HotineObliqueMercatorB,
}

/// A projection: angles in degrees from Greenwich, lengths in metres. What a method does not use is 0.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Projection {
    method: Method,
    /// Latitude of origin or centre.
    lat0: f64,
    /// Central meridian, or longitude of the centre.
    lon0: f64,
    /// Standard parallels, the southern one first; of stereographic and Mercator projections the latitude of true scale.
    parallels: [f64; 2],
    azimuth: f64,
    /// From the rectified to the skew grid.
    grid_angle: f64,
    /// On the central line, or at the origin.
    scale: f64,
    /// False easting and northing.
    offset: [f64; 2],
}

/// A geodetic datum as far as a definition tells.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Datum {
    /// EPSG code, where the datum is one of the register.
    code: Option<u32>,
    /// Semi-major axis, metres, and inverse flattening (0: a sphere).
    ellipsoid: [f64; 2],
    /// Shift to WGS 84 that the definition itself gives: metres, arc seconds, parts per million.
    to_wgs84: Option<[f64; 7]>,
}

/// Lengths that are equal to a millimetre, angles to as much on the ground, and scales, are equal: definitions round
/// differently (1,312,333.333 feet for 400 km).
const SAME_LENGTH: f64 = 1e-3;
const SAME_ANGLE: f64 = 1e-8;
const SAME_SCALE: f64 = 1e-9;

impl Projection {
    fn new(method: Method) -> Projection {
        Projection {
            method,
            lat0: 0.0,
            lon0: 0.0,
            parallels: [0.0; 2],
            azimuth: 0.0,
            grid_angle: 0.0,
            scale: 1.0,
            offset: [0.0; 2],
        }
    }

    /// Itself where all of its numbers are some.
    fn checked(self) -> Option<Projection> {
        let [lat1, lat2] = self.parallels;
        let [east, north] = self.offset;
        let numbers =
            [self.lat0, self.lon0, lat1, lat2, self.azimuth, self.grid_angle, self.scale, east, north];
        numbers.iter().all(|v| v.is_finite()).then_some(self)
    }

    fn is(&self, other: &Projection) -> bool {
        let angles =
            |p: &Projection| [p.lat0, p.lon0, p.parallels[0], p.parallels[1], p.azimuth, p.grid_angle];
        let near = |a: f64, b: f64, tolerance: f64| (a - b).abs() <= tolerance;
        self.method == other.method
            && angles(self).into_iter().zip(angles(other)).all(|(a, b)| near(a, b, SAME_ANGLE))
            && near(self.scale, other.scale, SAME_SCALE)
            && self.offset.into_iter().zip(other.offset).all(|(a, b)| near(a, b, SAME_LENGTH))
    }

    fn method(&self) -> ProjectionMethod {
        let Projection { lat0, lon0, parallels: [lat1, lat2], azimuth, grid_angle, scale: k0, .. } = *self;
        let [false_easting, false_northing] = self.offset;
        match self.method {
            Method::TransverseMercator => {
                ProjectionMethod::TransverseMercator { lon0, lat0, k0, false_easting, false_northing }
            }
            Method::LambertConformalConic => ProjectionMethod::LambertConformalConic {
                lon0,
                lat0,
                lat1,
                lat2,
                k0,
                false_easting,
                false_northing,
            },
            Method::AlbersEqualArea => {
                ProjectionMethod::AlbersEqualArea { lon0, lat0, lat1, lat2, false_easting, false_northing }
            }
            Method::PolarStereographic => {
                ProjectionMethod::PolarStereographic { lon0, lat_ts: lat1, k0, false_easting, false_northing }
            }
            Method::ObliqueStereographic => {
                ProjectionMethod::ObliqueStereographic { lon0, lat0, k0, false_easting, false_northing }
            }
            Method::Mercator => {
                ProjectionMethod::Mercator { lon0, lat_ts: lat1, k0, false_easting, false_northing }
            }
            Method::WebMercator => ProjectionMethod::WebMercator,
            Method::LambertAzimuthalEqualArea => {
                ProjectionMethod::LambertAzimuthalEqualArea { lon0, lat0, false_easting, false_northing }
            }
            Method::CassiniSoldner => {
                ProjectionMethod::CassiniSoldner { lon0, lat0, false_easting, false_northing }
            }
            Method::HotineObliqueMercatorA | Method::HotineObliqueMercatorB => {
                ProjectionMethod::HotineObliqueMercator {
                    latc: lat0,
                    lonc: lon0,
                    azimuth,
                    rectified_grid_angle: grid_angle,
                    k0,
                    false_easting,
                    false_northing,
                    variant_b: self.method == Method::HotineObliqueMercatorB,
                }
            }
        }
    }
}

impl Datum {
    fn is_on_ellipsoid_of(&self, other: &Datum) -> bool {
        let [[a, rf], [b, of]] = [self.ellipsoid, other.ellipsoid];
        // GRS 80 and WGS 84 differ by 1.5e-6 in the inverse flattening, 0.1 mm on the ground.
        (a - b).abs() < 0.01 && (rf - of).abs() < 1e-5
    }

    fn has_own_shift(&self) -> bool {
        self.code.is_none() && self.to_wgs84.is_some_and(|shift| shift.iter().any(|&v| v != 0.0))
    }

    /// Whether the datums are one, as far as both tell: one that is not named is taken for any on its ellipsoid.
    fn is(&self, other: &Datum) -> bool {
        match (self.code, other.code) {
            (Some(a), Some(b)) => a == b,
            _ if self.has_own_shift() || other.has_own_shift() => {
                self.code == other.code && self.to_wgs84 == other.to_wgs84 && self.is_on_ellipsoid_of(other)
            }
            _ => self.is_on_ellipsoid_of(other),
        }
    }

    fn definition(&self) -> Option<proj_core::Datum> {
        if let Some(datum) = self.code.and_then(proj_core::lookup_datum_epsg) {
            return Some(datum);
        }
        let [a, rf] = self.ellipsoid;
        let ellipsoid = if rf == 0.0 { Ellipsoid::sphere(a) } else { Ellipsoid::from_a_rf(a, rf) }.ok()?;
        let shift = match self.to_wgs84.filter(|_| self.has_own_shift()) {
            Some([dx, dy, dz, rx, ry, rz, ds]) => {
                DatumToWgs84::Helmert(HelmertParams::new(dx, dy, dz, rx, ry, rz, ds).ok()?)
            }
            None if self.to_wgs84.is_some() => DatumToWgs84::Identity,
            None => DatumToWgs84::Unknown,
        };
        proj_core::Datum::new(ellipsoid, shift).ok()
    }
}

/// The datum of WGS 84 itself.
const WGS84: Datum = Datum { code: Some(6326), ellipsoid: [6_378_137.0, 298.257_223_563], to_wgs84: None };

impl System {
    /// Longitude and latitude in degrees, or geocentric metres, on WGS 84: what coordinates of files that name no
    /// system may be recognised as.
    pub fn wgs84(geocentric: bool) -> System {
        match geocentric {
            false => System { form: Form::Geographic, datum: WGS84, unit: 1.0, code: Some(4326) },
            true => System { form: Form::Geocentric, datum: WGS84, unit: 1.0, code: Some(4978) },
        }
    }

    /// Takes the horizontal node of a definition apart. `unit`: of X and Y, metres, or radians for an angle; `code`: its
    /// EPSG code. `None` where it says too little.
    pub fn from_wkt(node: &Node, kind: CrsKind, unit: f64, code: Option<u32>) -> Option<System> {
        let base = node.child(&["GEOGCS", "BASEGEOGCRS", "BASEGEODCRS", "GEOGCRS"]).unwrap_or(node);
        let degree = angle_unit(base);
        let meridian = prime_meridian(base);
        let datum = datum_of(base, meridian.is_some(), code)?;
        let form = match kind {
            CrsKind::Geographic if meridian.is_none() => Form::Geographic,
            CrsKind::Geocentric if meridian.is_none() => Form::Geocentric,
            CrsKind::Projected => match projection_of(node, unit, degree, meridian.unwrap_or(0.0), code) {
                Some(projection) => Form::Projected(projection),
                None => return code.and_then(|code| System::registered(code, unit)),
            },
            _ => return None,
        };
        let unit = if kind == CrsKind::Geographic { unit.to_degrees() } else { unit };
        Some(System { form, datum, unit, code })
    }

    /// A system of which the register knows what it is and this module does not.
    fn registered(code: u32, unit: f64) -> Option<System> {
        let definition = proj_core::lookup_epsg(code)?;
        let datum = definition.datum();
        let [a, f] = [datum.ellipsoid().semi_major_axis(), datum.ellipsoid().flattening()];
        let ellipsoid = [a, if f == 0.0 { 0.0 } else { 1.0 / f }];
        let known = Some(datum.epsg()).filter(|&code| code != 0);
        definition.is_projected().then_some(System {
            form: Form::Registered(code),
            datum: Datum { code: known, ellipsoid, to_wgs84: None },
            unit,
            code: Some(code),
        })
    }

    /// A projection that the keys of a GeoTIFF directory spell out (OGC 19-008r4, annex C). `parameter` gives the value
    /// of a key, `method` is the value of key 3075, `conversion` that of 3074.
    pub fn from_geokeys(
        [method, conversion, geodetic]: [Option<u16>; 3],
        unit: f64,
        angle_unit: f64,
        ellipsoid: Option<[f64; 2]>,
        parameter: impl Fn(u16) -> Option<f64>,
    ) -> Option<System> {
        let base = geodetic.map(u32::from).and_then(proj_core::lookup_epsg);
        let datum = match base.as_ref().map(CrsDef::datum) {
            Some(datum) => {
                let f = datum.ellipsoid().flattening();
                Datum {
                    code: Some(datum.epsg()).filter(|&code| code != 0),
                    ellipsoid: [datum.ellipsoid().semi_major_axis(), if f == 0.0 { 0.0 } else { 1.0 / f }],
                    to_wgs84: None,
                }
            }
            None => Datum { code: None, ellipsoid: ellipsoid?, to_wgs84: None },
        };
        // Conversions of UTM zones: 16001 to 16060 in the north, 16101 to 16160 in the south.
        let projection = match (conversion, method) {
            (Some(zone @ (16001..=16060 | 16101..=16160)), _) => Projection {
                lon0: f64::from(zone % 100) * 6.0 - 183.0,
                scale: 0.9996,
                offset: [500_000.0, if zone > 16100 { 1e7 } else { 0.0 }],
                ..Projection::new(Method::TransverseMercator)
            },
            (_, Some(method)) => {
                let angle = |keys: &[u16]| {
                    keys.iter().find_map(|&key| parameter(key)).map(|v| (v * angle_unit).to_degrees())
                };
                let length = |keys: &[u16]| keys.iter().find_map(|&key| parameter(key)).map(|v| v * unit);
                let method = match method {
                    1 => Method::TransverseMercator,
                    8 | 9 => Method::LambertConformalConic,
                    11 => Method::AlbersEqualArea,
                    _ => return None,
                };
                let lat0 = angle(&[3081, 3085, 3089]).unwrap_or(0.0);
                let parallels = match method {
                    Method::TransverseMercator => [0.0; 2],
                    _ => {
                        let first = angle(&[3078]).unwrap_or(lat0);
                        in_order([first, angle(&[3079]).unwrap_or(first)])
                    }
                };
                Projection {
                    lat0,
                    lon0: angle(&[3080, 3084, 3088])?,
                    parallels,
                    scale: parameter(3092).unwrap_or(1.0),
                    offset: [length(&[3082, 3086]).unwrap_or(0.0), length(&[3083, 3087]).unwrap_or(0.0)],
                    ..Projection::new(method)
                }
            }
            _ => return None,
        };
        Some(System { form: Form::Projected(projection.checked()?), datum, unit, code: None })
    }

    /// The same with coordinates in another unit: metres, or radians for an angle.
    pub fn in_unit(self, unit: f64) -> System {
        let unit = if self.is_geographic() { unit.to_degrees() } else { unit };
        System { unit, code: None, ..self }
    }

    /// Whether coordinates mean the same in both.
    pub fn is(&self, other: &System) -> bool {
        let same_form = match (&self.form, &other.form) {
            (Form::Projected(a), Form::Projected(b)) => a.is(b),
            (a, b) => a == b,
        };
        same_form && (self.unit / other.unit - 1.0).abs() < 1e-9 && self.datum.is(&other.datum)
    }

    /// Whether the datum is one of the register.
    pub fn names_its_datum(&self) -> bool {
        self.datum.code.is_some() || self.datum.has_own_shift()
    }

    /// Whether coordinates are longitude and latitude.
    pub fn is_geographic(&self) -> bool {
        self.form == Form::Geographic
    }

    /// Whether coordinates count from the Earth's centre.
    pub fn is_geocentric(&self) -> bool {
        self.form == Form::Geocentric
    }

    /// One unit of X and Y, in degrees for geographic systems, else in metres.
    pub fn unit(&self) -> f64 {
        self.unit
    }

    /// Ground metres that one metre of this projection is at `latitude` (degrees), along E and N, where that is far from
    /// 1 wherever the data lies: Mercator projections, which stretch by 1 / cos of the latitude.
    pub fn ground_scale(&self, latitude: f64) -> Option<[f64; 2]> {
        let Form::Projected(projection) = &self.form else { return None };
        let [a, rf] = self.datum.ellipsoid;
        let f = if rf == 0.0 { 0.0 } else { 1.0 / rf };
        let e2 = f * (2.0 - f);
        let radii = |latitude: f64| {
            let (sin, cos) = latitude.to_radians().sin_cos();
            let w2 = 1.0 - e2 * sin * sin;
            // Of the parallel, and of curvature along the meridian.
            (a * cos / w2.sqrt(), a * (1.0 - e2) / (w2 * w2.sqrt()), cos)
        };
        let (parallel, meridian, cos) = radii(latitude);
        match projection.method {
            // A sphere of the equator's radius: X = a · λ, dY = a / cos φ · dφ.
            Method::WebMercator => Some([parallel / a, meridian * cos / a]),
            Method::Mercator => {
                let (true_parallel, _, _) = radii(projection.parallels[0]);
                let scale = parallel / (true_parallel * projection.scale);
                Some([scale, scale])
            }
            _ => None,
        }
    }

    /// The system as the library of projections has it.
    pub(super) fn definition(&self) -> Option<CrsDef> {
        let datum = self.datum;
        let definition = datum.definition()?;
        // Operations are registered between geographic systems as well as between datums.
        let registered = self.code.and_then(proj_core::lookup_epsg);
        let registered = registered.filter(|known| Some(known.datum().epsg()) == datum.code);
        let base = registered.as_ref().and_then(CrsDef::base_geographic_crs_epsg).unwrap_or(0);
        Some(match self.form {
            Form::Geographic => CrsDef::Geographic(GeographicCrsDef::new(base, definition, "")),
            Form::Geocentric => CrsDef::Geocentric(GeocentricCrsDef::new(0, base, definition, "")),
            Form::Projected(projection) => {
                let unit = LinearUnit::from_meters_per_unit(self.unit).ok()?;
                let method = projection.method();
                CrsDef::Projected(ProjectedCrsDef::new_with_base_geographic_crs(
                    0, base, definition, method, unit, "",
                ))
            }
            Form::Registered(code) => {
                let unit = LinearUnit::from_meters_per_unit(self.unit).ok()?;
                let method = proj_core::lookup_epsg(code)?.as_projected()?.method();
                CrsDef::Projected(ProjectedCrsDef::new_with_base_geographic_crs(
                    0, base, definition, method, unit, "",
                ))
            }
        })
    }

    /// The shifts to WGS 84 that the two definitions give themselves, as an operation between them.
    pub(super) fn own_operation(&self, other: &System) -> Option<CoordinateOperation> {
        if !self.datum.has_own_shift() && !other.datum.has_own_shift() {
            return None;
        }
        let shift = |system: &System| {
            let shift = system.datum.definition()?;
            match shift.to_wgs84() {
                DatumToWgs84::Unknown => None,
                known => Some(known.clone()),
            }
        };
        Some(CoordinateOperation {
            id: None,
            name: "shift to WGS 84 that the definition gives".into(),
            source_crs_epsg: None,
            target_crs_epsg: None,
            source_datum_epsg: None,
            target_datum_epsg: None,
            accuracy: None,
            areas_of_use: Default::default(),
            deprecated: false,
            preferred: true,
            approximate: false,
            superseded: false,
            domain: OperationDomain::HorizontalOnly,
            method: OperationMethod::DatumShift {
                source_to_wgs84: shift(self)?,
                target_to_wgs84: shift(other)?,
            },
        })
    }

    /// Whether a null shift between the two datums is wrong by no more than the metre or two that modern geocentric
    /// datums differ by: both lie on GRS 80 or WGS 84.
    pub fn is_near(&self, other: &System) -> bool {
        self.datum.is_on_ellipsoid_of(&WGS84) && other.datum.is_on_ellipsoid_of(&WGS84)
    }

    /// Whether both name one datum.
    pub(super) fn is_on_datum_of(&self, other: &System) -> bool {
        self.datum.code.is_some() && self.datum.code == other.datum.code
            || self.datum.has_own_shift() && self.datum.is(&other.datum)
    }

    /// Whether one of the two names no datum, and that of the other may be its own: on ellipsoids that several datums
    /// share, such as Bessel's, those may be a hundred metres apart.
    pub(super) fn may_be_on_datum_of(&self, other: &System) -> bool {
        !(self.names_its_datum() && other.names_its_datum())
            && self.datum.is(&other.datum)
            && self.is_near(other)
    }

    /// Both on the datum that one of them names; on one of no name where neither does.
    pub(super) fn on_one_datum(&self, other: &System) -> [System; 2] {
        let named = [other, self].into_iter().find(|system| system.names_its_datum());
        let datum = match named {
            Some(system) => system.datum,
            None => Datum { to_wgs84: Some([0.0; 7]), ..other.datum },
        };
        [self, other].map(|system| System { datum, code: None, ..*system })
    }
}

fn in_order([a, b]: [f64; 2]) -> [f64; 2] {
    [a.min(b), a.max(b)]
}

/// A name without what programs spell differently.
fn plain(name: &str) -> String {
    name.chars().filter(char::is_ascii_alphanumeric).flat_map(char::to_lowercase).collect()
}

/// Radians in the unit of angles of a geographic node.
fn angle_unit(base: &Node) -> f64 {
    let axis = || base.child(&["AXIS"]).and_then(|axis| axis.child(&["ANGLEUNIT"]));
    let unit = base.child(&["UNIT", "ANGLEUNIT"]).or_else(axis);
    unit.and_then(|unit| unit.number(1)).filter(|si| si.is_finite() && *si > 0.0).unwrap_or(1f64.to_radians())
}

/// Degrees east of Greenwich, where it is another one.
fn prime_meridian(base: &Node) -> Option<f64> {
    let node = base.child(&["PRIMEM", "PRIMEMERIDIAN"])?;
    let value = node.number(1).filter(|v| *v != 0.0)?;
    if let Some(unit) = node.child(&["ANGLEUNIT"]).and_then(|unit| unit.number(1)) {
        return Some((value * unit).to_degrees());
    }
    // The standard wants the unit of the node, most programs write degrees: Paris alone is written in grads, too.
    const PARIS_GRADS: f64 = 2.596_921_3;
    Some(if (value - PARIS_GRADS).abs() < 1e-5 { value * 0.9 } else { value })
}

/// The datum of a geographic node; `code`: of the whole system. Those that count from another meridian than Greenwich
/// are named after both.
fn datum_of(base: &Node, has_meridian: bool, code: Option<u32>) -> Option<Datum> {
    let node = base.child(&["DATUM", "GEODETICDATUM", "TRF", "ENSEMBLE"])?;
    let spheroid = node.child(&["SPHEROID", "ELLIPSOID"])?;
    let ellipsoid = [spheroid.number(1)?, spheroid.number(2)?];
    if !(ellipsoid[0] > 1e6 && ellipsoid[0] < 1e8 && (ellipsoid[1] == 0.0 || ellipsoid[1] > 1.0)) {
        return None;
    }
    let unknown = Datum { code: None, ellipsoid, to_wgs84: to_wgs84(node) };
    let fits = |code: &u32| {
        proj_core::lookup_datum_epsg(*code).is_some_and(|known| {
            let f = known.ellipsoid().flattening();
            let rf = if f == 0.0 { 0.0 } else { 1.0 / f };
            let known = Datum { ellipsoid: [known.ellipsoid().semi_major_axis(), rf], ..unknown };
            known.is_on_ellipsoid_of(&unknown)
        })
    };
    let by_name = || {
        let name = node.name()?;
        if !has_meridian {
            return proj_core::lookup_datum_code_for_name(name);
        }
        // The meridian's name, in brackets or not, is the last word.
        let (short, _) = name.trim_end_matches(')').rsplit_once(['_', ' ', '('])?;
        proj_core::lookup_datum_code_for_name(short)
    };
    let named = || (!has_meridian).then(|| epsg(node)).flatten();
    let of_base =
        || (!has_meridian).then(|| epsg(base).and_then(proj_core::lookup_datum_code_for_crs)).flatten();
    let of_whole = || (!has_meridian).then(|| code.and_then(proj_core::lookup_datum_code_for_crs)).flatten();
    let code = named()
        .filter(fits)
        .or_else(|| by_name().filter(fits))
        .or_else(|| of_base().filter(fits))
        .or_else(|| of_whole().filter(fits));
    Some(Datum { code, ..unknown })
}

fn to_wgs84(datum: &Node) -> Option<[f64; 7]> {
    let node = datum.child(&["TOWGS84"])?;
    let mut shift = [0.0; 7];
    let given = (0..7).map_while(|k| node.number(k)).enumerate().map(|(k, v)| shift[k] = v).count();
    (given >= 3 && shift.iter().all(|v| v.is_finite())).then_some(shift)
}

fn epsg(node: &Node) -> Option<u32> {
    let id = node.child(&["AUTHORITY", "ID"])?;
    let code = id.number(1)?;
    (id.name()?.eq_ignore_ascii_case("EPSG") && (1.0..1e6).contains(&code)).then_some(code as u32)
}

/// The method that a definition calls `name`, in plain letters. `is_sphere`: it means the sphere of web maps.
fn method_of(name: &str, is_sphere: impl Fn() -> bool) -> Option<Method> {
    Some(match name {
        "transversemercator" | "gausskruger" | "transversemercatorcomplex" => Method::TransverseMercator,
        "lambertconformalconic"
        | "lambertconformalconic1sp"
        | "lambertconformalconic2sp"
        | "lambertconicconformal1sp"
        | "lambertconicconformal2sp" => Method::LambertConformalConic,
        "albers" | "albersconicequalarea" | "albersequalarea" => Method::AlbersEqualArea,
        "polarstereographic"
        | "polarstereographicvarianta"
        | "polarstereographicvariantb"
        | "stereographicnorthpole"
        | "stereographicsouthpole" => Method::PolarStereographic,
        "obliquestereographic" | "doublestereographic" => Method::ObliqueStereographic,
        "mercatorauxiliarysphere" | "popularvisualisationpseudomercator" => Method::WebMercator,
        "mercator1sp" if is_sphere() => Method::WebMercator,
        "mercator" | "mercator1sp" | "mercator2sp" | "mercatorvarianta" | "mercatorvariantb" => {
            Method::Mercator
        }
        "lambertazimuthalequalarea" => Method::LambertAzimuthalEqualArea,
        "cassinisoldner" | "cassini" => Method::CassiniSoldner,
        "hotineobliquemercator"
        | "hotineobliquemercatorvarianta"
        | "hotineobliquemercatorazimuthnaturalorigin" => Method::HotineObliqueMercatorA,
        "hotineobliquemercatorazimuthcenter"
        | "hotineobliquemercatorvariantb"
        | "swissobliquecylindrical"
        | "swissobliquemercator" => Method::HotineObliqueMercatorB,
        _ => return None,
    })
}

/// The projection of a projected node; `unit`: metres, `degree`: radians.
fn projection_of(
    node: &Node,
    unit: f64,
    degree: f64,
    meridian: f64,
    code: Option<u32>,
) -> Option<Projection> {
    let conversion = node.child(&["CONVERSION"]).unwrap_or(node);
    let method = plain(conversion.child(&["PROJECTION", "METHOD"])?.name()?);
    let mut parameters: Vec<(String, f64)> = Vec::new();
    for parameter in conversion.children(&["PARAMETER"]) {
        let (name, value) = (plain(parameter.name()?), parameter.number(1)?);
        let own = parameter.child(&["ANGLEUNIT", "LENGTHUNIT", "SCALEUNIT", "UNIT"]);
        let si = own.and_then(|unit| unit.number(1));
        let is_length = name.contains("easting") || name.contains("northing");
        let is_scale = name.contains("scale");
        let value = match (is_length, is_scale) {
            (true, _) => value * si.unwrap_or(unit),
            (_, true) => value * si.unwrap_or(1.0),
            _ => (value * si.unwrap_or(degree)).to_degrees(),
        };
        parameters.push((name, value));
    }
    let find = |names: &[&str]| {
        names.iter().find_map(|name| parameters.iter().find(|(known, _)| known == name)).map(|p| p.1)
    };
    let or_zero = |names: &[&str]| find(names).unwrap_or(0.0);
    let lat0 = find(&[
        "latitudeoforigin",
        "latitudeofnaturalorigin",
        "latitudeofcenter",
        "latitudeofcentre",
        "latitudeofprojectioncentre",
        "latitudeoffalseorigin",
    ]);
    let longitudes = [
        "centralmeridian",
        "longitudeofnaturalorigin",
        "longitudeofcenter",
        "longitudeofcentre",
        "longitudeoforigin",
        "longitudeoffalseorigin",
        "longitudeofprojectioncentre",
        "straightverticallongitudefrompole",
    ];
    let first = find(&["standardparallel1", "latitudeof1ststandardparallel", "latitudeofstandardparallel"]);
    let second = find(&["standardparallel2", "latitudeof2ndstandardparallel"]);
    let scale = find(&[
        "scalefactor",
        "scalefactoratnaturalorigin",
        "scalefactoroninitialline",
        "scalefactoratprojectioncentre",
    ]);
    let extension = node.child(&["EXTENSION"]).and_then(|e| e.values.get(1)).and_then(|value| match value {
        super::wkt::Value::Text(text) => Some(text.as_ref()),
        _ => None,
    });
    let is_sphere = || code == Some(3857) || extension.is_some_and(|text| text.contains("+b=6378137 "));
    let method = method_of(&method, is_sphere)?;
    let mut projection = Projection {
        lat0: lat0.unwrap_or(0.0),
        lon0: or_zero(&longitudes) + meridian,
        scale: scale.unwrap_or(1.0),
        offset: [
            or_zero(&["falseeasting", "eastingatfalseorigin", "eastingatprojectioncentre"]),
            or_zero(&["falsenorthing", "northingatfalseorigin", "northingatprojectioncentre"]),
        ],
        ..Projection::new(method)
    };
    match method {
        Method::LambertConformalConic => {
            let first = first.or(lat0)?;
            projection.parallels = in_order([first, second.unwrap_or(first)]);
            projection.lat0 = lat0.unwrap_or(first);
        }
        Method::AlbersEqualArea => projection.parallels = in_order([first?, second.or(first)?]),
        Method::PolarStereographic => {
            // Either the latitude of true scale, or the pole and the scale there.
            let latitude = first.or(lat0)?;
            (projection.lat0, projection.parallels) = (0.0, [latitude, 0.0]);
            if latitude.abs() < 90.0 {
                projection.scale = 1.0;
            }
        }
        Method::Mercator => {
            (projection.lat0, projection.parallels) = (0.0, [first.unwrap_or(0.0), 0.0]);
        }
        Method::WebMercator => projection = Projection::new(Method::WebMercator),
        Method::HotineObliqueMercatorA | Method::HotineObliqueMercatorB => {
            let azimuth =
                find(&["azimuth", "azimuthofinitialline", "azimuthatprojectioncentre"]).unwrap_or(90.0);
            let angle = find(&["rectifiedgridangle", "anglefromrectifiedtoskewgrid", "xyplanerotation"]);
            (projection.azimuth, projection.grid_angle) = (azimuth, angle.unwrap_or(azimuth));
        }
        _ => {}
    }
    projection.checked()
}

#[cfg(test)]
mod tests {
    use super::super::crs::{definition, from_wkt};
    use super::*;
    use proj_core::{Coord, Transform};

    /// The register's own definitions, taken apart here, give the coordinates that the library's register gives.
    #[test]
    fn definitions_are_taken_apart_as_the_register_means_them() {
        let (mut compared, mut methods) = (0, std::collections::BTreeMap::<String, u32>::new());
        for code in 0..=u16::MAX {
            let Some(system) = definition(code).and_then(|crs| crs.system) else { continue };
            let Form::Projected(projection) = system.form else { continue };
            let Some(known) = proj_core::lookup_epsg(code.into()).and_then(|known| known.horizontal_crs())
            else {
                continue;
            };
            // The library's own definitions count from the system's meridian.
            if !crs_definitions::from_code(code).unwrap().wkt.contains(r#"PRIMEM["Greenwich",0"#) {
                continue;
            }
            // On one datum: what shifts there are is another question.
            let datum = known.datum().clone();
            let unit = LinearUnit::from_meters_per_unit(system.unit).unwrap();
            let ours =
                CrsDef::Projected(ProjectedCrsDef::new(0, datum.clone(), projection.method(), unit, ""));
            let degrees = CrsDef::Geographic(GeographicCrsDef::new(0, datum, ""));
            let (Ok(to_known), Ok(to_ours)) = (
                Transform::from_crs_defs(&degrees, &known.with_datum(degrees.datum().clone())),
                Transform::from_crs_defs(&degrees, &ours),
            ) else {
                continue;
            };
            let lat = match projection.method {
                Method::PolarStereographic => {
                    projection.parallels[0] - projection.parallels[0].signum() * 2.0
                }
                _ if projection.parallels != [0.0; 2] => projection.parallels[0],
                _ => projection.lat0,
            };
            for (east, north) in [(0.5, 0.5), (-0.5, 0.3), (1.0, -0.2)] {
                let lat = (lat + north).clamp(-89.0, 89.0);
                let at = Coord::new(projection.lon0 + east, lat);
                let (Ok(a), Ok(b)) = (to_known.convert(at), to_ours.convert(at)) else { continue };
                let apart = (a.x - b.x).hypot(a.y - b.y) * system.unit;
                // The registers differ in whether this false easting is in metres or in chains.
                if code != 3167 {
                    assert!(apart < 2e-3, "EPSG:{code} {projection:?}: {a:?} {b:?}");
                }
                compared += 1;
            }
            *methods.entry(format!("{:?}", projection.method)).or_default() += 1;
        }
        assert!(compared > 12_000, "{compared} {methods:?}");
        assert!(methods.len() == 11, "{methods:?}");
    }

    const ESRI: &str = r#"PROJCS["ETRS_1989_UTM_Zone_32N",GEOGCS["GCS_ETRS_1989",DATUM["D_ETRS_1989",
        SPHEROID["GRS_1980",6378137.0,298.257222101]],PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]],
        PROJECTION["Transverse_Mercator"],PARAMETER["False_Easting",500000.0],PARAMETER["False_Northing",0.0],
        PARAMETER["Central_Meridian",9.0],PARAMETER["Scale_Factor",0.9996],PARAMETER["Latitude_Of_Origin",0.0],
        UNIT["Meter",1.0]]"#;
    const WKT2: &str = r#"COMPOUNDCRS["any",PROJCRS["whatever",BASEGEOGCRS["ETRS89",
        ENSEMBLE["European Terrestrial Reference System 1989 ensemble",MEMBER["x"],
        ELLIPSOID["GRS 1980",6378137,298.257222101,LENGTHUNIT["metre",1]],ENSEMBLEACCURACY[0.1]],
        PRIMEM["Greenwich",0,ANGLEUNIT["degree",0.0174532925199433]],ID["EPSG",4258]],
        CONVERSION["UTM zone 32N",METHOD["Transverse Mercator",ID["EPSG",9807]],
        PARAMETER["Latitude of natural origin",0,ANGLEUNIT["degree",0.0174532925199433]],
        PARAMETER["Longitude of natural origin",9,ANGLEUNIT["degree",0.0174532925199433]],
        PARAMETER["Scale factor at natural origin",0.9996,SCALEUNIT["unity",1]],
        PARAMETER["False easting",500000,LENGTHUNIT["metre",1]],
        PARAMETER["False northing",0,LENGTHUNIT["metre",1]]],CS[Cartesian,2],AXIS["(E)",east,ORDER[1]],
        AXIS["(N)",north,ORDER[2]],LENGTHUNIT["metre",1]],VERTCRS["h",VDATUM["d"],CS[vertical,1],
        AXIS["up",up],LENGTHUNIT["metre",1]]]"#;

    #[test]
    fn names_decide_nothing() {
        let of = |text: &str| from_wkt(text).unwrap().system.unwrap();
        let code = |code| definition(code).unwrap().system.unwrap();
        let utm = code(25832);
        let unnamed = ESRI.replace("ETRS_1989_UTM_Zone_32N", "unknown").replace("D_ETRS_1989", "unknown");
        for other in [of(ESRI), of(WKT2), of(&unnamed)] {
            assert!(utm.is(&other) && other.is(&utm), "{other:?}");
        }
        // Zone, datum, unit and ellipsoid decide.
        let zone = ESRI.replace(r#""Central_Meridian",9.0"#, r#""Central_Meridian",15.0"#);
        let wgs = ESRI.replace("D_ETRS_1989", "D_WGS_1984").replace("298.257222101", "298.257223563");
        let feet = ESRI.replace(r#"UNIT["Meter",1.0]"#, r#"UNIT["Foot",0.3048]"#);
        let bessel = unnamed.replace("6378137.0,298.257222101", "6377397.155,299.1528128");
        for other in [of(&zone), of(&wgs), of(&feet), of(&bessel), code(25833), code(4258)] {
            assert!(!utm.is(&other) && !other.is(&utm), "{other:?}");
        }
        assert!(of(&wgs).is(&code(32632)) && of(&zone).is(&code(25833)));
        // A text that contradicts its code is what it says.
        let contradicting =
            ESRI.replace(r#"UNIT["Meter",1.0]]"#, r#"UNIT["Meter",1.0],AUTHORITY["EPSG","6341"]]"#);
        assert!(of(&contradicting).is(&of(&unnamed)));
        // Standard parallels in either order; feet rounded to a millimetre.
        let lambert = code(2154);
        let swapped = from_wkt(
            r#"PROJCS["x",GEOGCS["RGF93",DATUM["D_RGF_1993",SPHEROID["GRS_1980",6378137,298.257222101]],
            PRIMEM["Greenwich",0],UNIT["Degree",0.0174532925199433]],PROJECTION["Lambert_Conformal_Conic"],
            PARAMETER["False_Easting",700000.0003],PARAMETER["False_Northing",6600000],
            PARAMETER["Central_Meridian",3],PARAMETER["Standard_Parallel_1",44],
            PARAMETER["Standard_Parallel_2",49],PARAMETER["Latitude_Of_Origin",46.5],UNIT["Meter",1]]"#,
        );
        assert!(swapped.unwrap().system.unwrap().is(&lambert));
    }

    #[test]
    fn units_of_angles_and_of_registered_projections_count() {
        let degrees = definition(4326).unwrap().system.unwrap();
        let grads = degrees.in_unit(1f64.to_radians() * 0.9);
        assert!((grads.unit() - 0.9).abs() < 1e-12);
        // Krovak is not taken apart here.
        let krovak = definition(5514).unwrap().system.unwrap();
        assert!(matches!(krovak.form, Form::Registered(5514)));
        let feet = krovak.in_unit(0.3048).definition().unwrap();
        assert_eq!(feet.as_projected().unwrap().linear_unit_to_meter(), 0.3048);
        let broken = ESRI.replace(r#""Central_Meridian",9.0"#, r#""Central_Meridian",nan"#);
        assert_eq!(from_wkt(&broken).unwrap().system, None);
    }

    #[test]
    fn mercator_stretches() {
        let web = definition(3857).unwrap().system.unwrap();
        let [east, north] = web.ground_scale(60.0).unwrap();
        // Half a metre for a metre, but for the ellipsoid.
        assert!((east - 0.5013).abs() < 1e-3 && (north - 0.5004).abs() < 1e-3, "{east} {north}");
        assert_eq!(definition(25832).unwrap().system.unwrap().ground_scale(60.0), None);
        let [east, north] = definition(3395).unwrap().system.unwrap().ground_scale(60.0).unwrap();
        assert!(east == north && (east - 0.5013).abs() < 1e-3, "{east}");
    }
}
