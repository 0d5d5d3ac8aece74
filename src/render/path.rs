//! Camera paths: keyframes, the JSON file that holds them, and the paths of the benchmark.
//!
//! The format is described in `docs/camera-paths.md`.

use super::camera::{Camera, CameraError, DEFAULT_FOV, Projection};
use super::saved_view::SavedView;
use crate::output::Output;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::fmt::Write as _;
use std::io::{self, Read as _, Write as _};
use std::path::{Path, PathBuf};

/// Version of the format that is read and written.
pub const VERSION: u32 = 1;
/// Frames a second when a file names none.
pub const DEFAULT_FPS: f64 = 60.0;
/// Most frames of a path.
pub const MOST_FRAMES: u32 = 10_000_000;

/// What is between keyframes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Interpolation {
    /// Straight and even from one to the next.
    Linear,
    /// A cubic through all of them without a jerk: Catmull-Rom for times that need not be even.
    #[default]
    Smooth,
    /// Each holds until the next.
    Step,
}

/// What a keyframe looks at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Aim {
    /// A place: E, N, U.
    Target(DVec3),
    /// Azimuth clockwise from north and elevation, positive down; degrees. Azimuths are followed as numbers:
    /// from 0 to 360 is a full turn, from 350 to 370 a small one.
    Angles([f64; 2]),
}

/// Where the camera is at a time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "KeyframeText", into = "KeyframeText")]
pub struct Keyframe {
    /// Seconds.
    pub time: f64,
    /// Where rays start.
    pub eye: DVec3,
    /// Where they go.
    pub aim: Aim,
}

impl Keyframe {
    fn camera(&self, projection: Projection) -> Result<Camera, CameraError> {
        match self.aim {
            Aim::Target(target) => Camera::look_at(self.eye, target, projection),
            Aim::Angles(angles) => Camera::looking(self.eye, angles, projection),
        }
    }

    /// Eye, and target or angles.
    fn pose(&self) -> [f64; 6] {
        let [e, n, u] = self.eye.to_array();
        match self.aim {
            Aim::Target(t) => [e, n, u, t.x, t.y, t.z],
            Aim::Angles([azimuth, elevation]) => [e, n, u, azimuth, elevation, 0.0],
        }
    }

    /// The same kind of aim with another pose.
    fn posed(&self, [e, n, u, x, y, z]: [f64; 6]) -> Keyframe {
        let aim = match self.aim {
            Aim::Target(_) => Aim::Target(DVec3::new(x, y, z)),
            // A cubic may swing over the top.
            Aim::Angles(_) => Aim::Angles([x, y.clamp(-90.0, 90.0)]),
        };
        Keyframe { eye: DVec3::new(e, n, u), aim, ..*self }
    }
}

/// What a path cannot be.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum PathFault {
    /// No keyframe.
    #[error("keyframes: there is none")]
    Empty,
    /// A keyframe that is no camera.
    #[error("keyframe {number}: {error}")]
    Camera {
        /// Counted from 1.
        number: usize,
        /// Why.
        error: CameraError,
    },
    /// Out of order.
    #[error("keyframe {number}: time {time} is not after {before}, that of the one before")]
    Order {
        /// Counted from 1.
        number: usize,
        /// Its time, seconds.
        time: f64,
        /// The time that it must be after, seconds.
        before: f64,
    },
    /// Targets and angles in one path.
    #[error("keyframe {0}: a path has a target in each keyframe, or angles in each")]
    Mixed(usize),
    /// Frames a second.
    #[error("fps is {0}: it must be finite and above 0")]
    Fps(f64),
    /// Longer than anyone can draw.
    #[error("the path has {0:.0} frames: more than {MOST_FRAMES} are not drawn")]
    TooLong(f64),
}

/// What is wrong with a file, and where.
#[derive(Debug, thiserror::Error)]
pub enum PathError {
    /// The system refuses.
    #[error("{path}: cannot be read: {reason}")]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: io::Error,
    },
    /// Something else.
    #[error("{path}: {what}, not a camera path")]
    NoPath {
        /// The file.
        path: PathBuf,
        /// What it is, with its article.
        what: &'static str,
    },
    /// Not a path of this version.
    #[error("{path}: version is {version}: this program reads camera paths of version {VERSION}")]
    Version {
        /// The file.
        path: PathBuf,
        /// As it says.
        version: u64,
    },
    /// Not JSON, or not what the format wants there.
    #[error("{path}: line {line}, column {column}: {reason}")]
    Text {
        /// The file.
        path: PathBuf,
        /// Counted from 1.
        line: usize,
        /// Counted from 1.
        column: usize,
        /// Why.
        reason: String,
    },
    /// Fields that do not go together.
    #[error("{path}: {fault}")]
    Fault {
        /// The file.
        path: PathBuf,
        /// Why.
        fault: PathFault,
    },
    /// The system refuses.
    #[error("{path}: cannot be written: {reason}")]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: io::Error,
    },
}

/// Keyframes and what is between them. World coordinates as [`Camera`] has them, or, in a file, as the command
/// line has them: see [`CameraPath::placed`].
#[derive(Clone, Debug, PartialEq)]
pub struct CameraPath {
    name: Option<String>,
    projection: Projection,
    fps: f64,
    interpolation: Interpolation,
    /// At least one, times rising, all with the same kind of aim.
    keyframes: Vec<Keyframe>,
    /// What is seen along it, where the file says that.
    view: Option<SavedView>,
}

impl CameraPath {
    /// Checks that it can be followed.
    pub fn new(
        keyframes: Vec<Keyframe>,
        projection: Projection,
        fps: f64,
        interpolation: Interpolation,
    ) -> Result<CameraPath, PathFault> {
        if !(fps.is_finite() && fps > 0.0) {
            return Err(PathFault::Fps(fps));
        }
        let (first, last) = match (keyframes.first(), keyframes.last()) {
            (Some(first), Some(last)) => (first, last),
            _ => return Err(PathFault::Empty),
        };
        let kind = std::mem::discriminant(&first.aim);
        for (number, k) in (1..).zip(&keyframes) {
            let wrong = |error| PathFault::Camera { number, error };
            k.camera(projection).map_err(wrong)?;
            if !k.time.is_finite() {
                return Err(wrong(CameraError::NotFinite { what: "time", value: k.time }));
            }
            if std::mem::discriminant(&k.aim) != kind {
                return Err(PathFault::Mixed(number));
            }
        }
        for (number, pair) in (2..).zip(keyframes.windows(2)) {
            if pair[1].time <= pair[0].time {
                return Err(PathFault::Order { number, time: pair[1].time, before: pair[0].time });
            }
        }
        let frames = (last.time - first.time) * fps;
        if frames > f64::from(MOST_FRAMES) {
            return Err(PathFault::TooLong(frames));
        }
        Ok(CameraPath { name: None, projection, fps, interpolation, keyframes, view: None })
    }

    /// The view of `camera`, for one frame.
    pub fn view(camera: &Camera) -> CameraPath {
        let keyframe = Keyframe { time: 0.0, eye: camera.eye(), aim: Aim::Target(camera.target()) };
        CameraPath {
            name: None,
            projection: camera.projection(),
            fps: DEFAULT_FPS,
            interpolation: Interpolation::default(),
            keyframes: vec![keyframe],
            view: None,
        }
    }

    /// The same with what is seen along it.
    pub fn with_view(self, view: SavedView) -> CameraPath {
        CameraPath { view: Some(view), ..self }
    }

    /// What is seen along it, where the file says that.
    pub fn saved_view(&self) -> Option<&SavedView> {
        self.view.as_ref()
    }

    /// The same under a name.
    pub fn named(self, name: impl Into<String>) -> CameraPath {
        CameraPath { name: Some(name.into()), ..self }
    }

    /// What it is called.
    pub fn name(&self) -> Option<&str> {
        self.name.as_deref()
    }

    /// How rays spread, all the way.
    pub fn projection(&self) -> Projection {
        self.projection
    }

    /// Frames a second.
    pub fn fps(&self) -> f64 {
        self.fps
    }

    /// What is between keyframes.
    pub fn interpolation(&self) -> Interpolation {
        self.interpolation
    }

    /// In order of time; at least one.
    pub fn keyframes(&self) -> &[Keyframe] {
        &self.keyframes
    }

    /// Seconds from the first keyframe to the last.
    pub fn duration(&self) -> f64 {
        self.keyframes[self.keyframes.len() - 1].time - self.keyframes[0].time
    }

    /// Duration × frames a second, at least 1: the last keyframe is where the next frame would be, so that a
    /// full turn has no frame twice.
    pub fn frames(&self) -> u32 {
        (self.duration() * self.fps).round().max(1.0) as u32
    }

    /// `count` frames spread evenly over the path, the first one first: the same film at a lower rate. All of them
    /// if it has no more. The first `count` in a row are just `0..count`.
    pub fn spread(&self, count: u32) -> impl ExactSizeIterator<Item = u32> + use<> {
        let all = u64::from(self.frames());
        let count = u64::from(count).min(all) as u32;
        (0..count).map(move |k| (u64::from(k) * all / u64::from(count)) as u32)
    }

    /// The camera of a frame, counted from 0; beyond the end that of the last keyframe. The same for the same path
    /// and frame.
    ///
    /// Errors: interpolation has led eye and target to one place.
    pub fn camera(&self, frame: u32) -> Result<Camera, CameraError> {
        self.at(f64::from(frame) / self.fps).camera(self.projection)
    }

    /// `seconds` after the first keyframe.
    fn at(&self, seconds: f64) -> Keyframe {
        let keyframes = &self.keyframes;
        let time = keyframes[0].time + seconds;
        // The last one whose time has come.
        let i = keyframes.partition_point(|k| k.time <= time).max(1) - 1;
        let [Some(from), Some(to)] = [keyframes.get(i), keyframes.get(i + 1)] else {
            return keyframes[keyframes.len() - 1];
        };
        let span = to.time - from.time;
        let f = (time - from.time) / span;
        let (p, q) = (from.pose(), to.pose());
        match self.interpolation {
            Interpolation::Step => *from,
            Interpolation::Linear => from.posed(std::array::from_fn(|c| p[c] + (q[c] - p[c]) * f)),
            Interpolation::Smooth => {
                let (leave, arrive) = (self.speed(i), self.speed(i + 1));
                // Cubic Hermite in differences: small numbers, whatever the northing.
                from.posed(std::array::from_fn(|c| {
                    p[c] + (q[c] - p[c]) * (f * f * (3.0 - 2.0 * f))
                        + span * leave[c] * (f * (1.0 - f) * (1.0 - f))
                        - span * arrive[c] * (f * f * (1.0 - f))
                }))
            }
        }
    }

    /// Change of the pose a second at keyframe `i`: that of the parabola through it and its neighbours.
    fn speed(&self, i: usize) -> [f64; 6] {
        let between = |a: usize| {
            let (a, b) = (self.keyframes.get(a)?, self.keyframes.get(a + 1)?);
            let (p, q, span) = (a.pose(), b.pose(), b.time - a.time);
            Some((std::array::from_fn::<f64, 6, _>(|c| (q[c] - p[c]) / span), span))
        };
        match (i.checked_sub(1).and_then(between), between(i)) {
            (Some((before, t)), Some((after, u))) => {
                std::array::from_fn(|c| (before[c] * u + after[c] * t) / (t + u))
            }
            (Some((only, _)), None) | (None, Some((only, _))) => only,
            (None, None) => [0.0; 6],
        }
    }

    /// The same with `place` applied to eyes and targets: from the coordinates that users type to the world's.
    pub fn placed(&self, place: impl Fn(DVec3) -> DVec3) -> Result<CameraPath, PathFault> {
        let keyframes = self.keyframes.iter().map(|k| {
            let aim = match k.aim {
                Aim::Target(target) => Aim::Target(place(target)),
                angles => angles,
            };
            Keyframe { eye: place(k.eye), aim, ..*k }
        });
        let placed = CameraPath::new(keyframes.collect(), self.projection, self.fps, self.interpolation)?;
        Ok(CameraPath { name: self.name.clone(), view: self.view.clone(), ..placed })
    }

    /// Reads a file.
    pub fn read(path: &Path) -> Result<CameraPath, PathError> {
        let owned = || path.to_owned();
        let failed = |reason| PathError::Read { path: owned(), reason };
        let (mut file, mut bytes) = (std::fs::File::open(path).map_err(failed)?, Vec::new());
        (&mut file).take(4).read_to_end(&mut bytes).map_err(failed)?;
        if bytes == b"LASF" {
            return Err(PathError::NoPath { path: owned(), what: "a point cloud" });
        }
        file.read_to_end(&mut bytes).map_err(failed)?;
        let text = String::from_utf8(bytes)
            .map_err(|_| PathError::NoPath { path: owned(), what: "a file without text" })?;
        // A later version may have fields that this one does not know.
        if let Ok(VersionText { version }) = serde_json::from_str(&text)
            && version != u64::from(VERSION)
        {
            return Err(PathError::Version { path: owned(), version });
        }
        let text: PathText = serde_json::from_str(&text).map_err(|error| {
            let (line, column) = (error.line(), error.column());
            let mut reason = error.to_string();
            reason.truncate(reason.rfind(" at line ").unwrap_or(reason.len()));
            PathError::Text { path: owned(), line, column, reason }
        })?;
        let PathText { name, projection, fps, interpolation, keyframes, view, .. } = text;
        let read = CameraPath::new(keyframes, projection.0, fps, interpolation)
            .map_err(|fault| PathError::Fault { path: owned(), fault })?;
        Ok(CameraPath { name, view, ..read })
    }

    /// Writes a file where none is, whole or not at all.
    pub fn write(&self, path: &Path) -> Result<(), PathError> {
        Output::fresh(path)
            .write(|out| out.write_all(self.text()?.as_bytes()))
            .map_err(|reason| PathError::Write { path: path.to_owned(), reason })
    }

    /// One line a keyframe.
    fn text(&self) -> io::Result<String> {
        let mut text = format!("{{\n  \"version\": {VERSION},\n");
        if let Some(name) = &self.name {
            let _ = writeln!(text, "  \"name\": {},", serde_json::to_string(name)?);
        }
        let projection = serde_json::to_string(&ProjectionText(self.projection))?;
        let _ = writeln!(text, "  \"projection\": {projection},");
        let _ = writeln!(text, "  \"fps\": {},", serde_json::to_string(&self.fps)?);
        let _ = writeln!(text, "  \"interpolation\": {},", serde_json::to_string(&self.interpolation)?);
        let keyframes: Result<Vec<_>, _> = self.keyframes.iter().map(serde_json::to_string).collect();
        let _ = write!(text, "  \"keyframes\": [\n    {}\n  ]", keyframes?.join(",\n    "));
        if let Some(view) = &self.view {
            let view = serde_json::to_string_pretty(view)?.replace('\n', "\n  ");
            let _ = write!(text, ",\n  \"view\": {view}");
        }
        text.push_str("\n}\n");
        Ok(text)
    }
}

#[derive(Deserialize)]
struct VersionText {
    version: u64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PathText {
    #[serde(rename = "version")]
    _version: u32,
    name: Option<String>,
    #[serde(default)]
    projection: ProjectionText,
    #[serde(default = "default_fps")]
    fps: f64,
    #[serde(default)]
    interpolation: Interpolation,
    keyframes: Vec<Keyframe>,
    view: Option<SavedView>,
}

fn default_fps() -> f64 {
    DEFAULT_FPS
}

/// `{"fov": 45}` or `{"units_per_pixel": 0.5}`.
#[derive(Clone, Copy, Default, Serialize, Deserialize)]
#[serde(try_from = "ProjectionFields", into = "ProjectionFields")]
struct ProjectionText(Projection);

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ProjectionFields {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    fov: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    units_per_pixel: Option<f64>,
}

impl TryFrom<ProjectionFields> for ProjectionText {
    type Error = String;
    fn try_from(fields: ProjectionFields) -> Result<ProjectionText, String> {
        let projection = match fields {
            ProjectionFields { fov: Some(_), units_per_pixel: Some(_) } => {
                return Err("projection: `fov` or `units_per_pixel`, not both".to_owned());
            }
            ProjectionFields { units_per_pixel: Some(units_per_pixel), .. } => {
                Projection::Orthographic { units_per_pixel }
            }
            ProjectionFields { fov, .. } => Projection::Perspective { fov: fov.unwrap_or(DEFAULT_FOV) },
        };
        projection.check().map(ProjectionText).map_err(|e| format!("projection: {e}"))
    }
}

impl From<ProjectionText> for ProjectionFields {
    fn from(ProjectionText(projection): ProjectionText) -> ProjectionFields {
        match projection {
            Projection::Perspective { fov } => ProjectionFields { fov: Some(fov), units_per_pixel: None },
            Projection::Orthographic { units_per_pixel } => {
                ProjectionFields { fov: None, units_per_pixel: Some(units_per_pixel) }
            }
        }
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct KeyframeText {
    time: f64,
    eye: [f64; 3],
    #[serde(default, skip_serializing_if = "Option::is_none")]
    target: Option<[f64; 3]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    angles: Option<AnglesText>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct AnglesText {
    azimuth: f64,
    elevation: f64,
}

impl TryFrom<KeyframeText> for Keyframe {
    type Error = String;
    fn try_from(text: KeyframeText) -> Result<Keyframe, String> {
        let aim = match (text.target, text.angles) {
            (Some(target), None) => Aim::Target(target.into()),
            (None, Some(AnglesText { azimuth, elevation })) => Aim::Angles([azimuth, elevation]),
            (None, None) => return Err("keyframe: `target` or `angles` is missing".to_owned()),
            (Some(_), Some(_)) => return Err("keyframe: `target` or `angles`, not both".to_owned()),
        };
        let keyframe = Keyframe { time: text.time, eye: text.eye.into(), aim };
        // Here the reader still knows the line.
        keyframe.camera(Projection::default()).map_err(|e| format!("keyframe: {e}"))?;
        Ok(keyframe)
    }
}

impl From<Keyframe> for KeyframeText {
    fn from(Keyframe { time, eye, aim }: Keyframe) -> KeyframeText {
        let (target, angles) = match aim {
            Aim::Target(target) => (Some(target.to_array()), None),
            Aim::Angles([azimuth, elevation]) => (None, Some(AnglesText { azimuth, elevation })),
        };
        KeyframeText { time, eye: eye.to_array(), target, angles }
    }
}

#[cfg(test)]
mod tests {
    use super::super::benchmark_path::{PathKind, tests::STAGE};
    use super::*;

    fn linear(keyframes: &[(f64, [f64; 3], [f64; 3])], interpolation: Interpolation) -> CameraPath {
        let keyframes = keyframes.iter().map(|&(time, eye, target)| Keyframe {
            time,
            eye: eye.into(),
            aim: Aim::Target(target.into()),
        });
        CameraPath::new(keyframes.collect(), Projection::default(), 10.0, interpolation).unwrap()
    }

    fn eyes(path: &CameraPath) -> Vec<DVec3> {
        (0..path.frames()).map(|frame| path.camera(frame).unwrap().eye()).collect()
    }

    #[test]
    fn keyframes_are_met_at_their_times() {
        let three = [
            (2.0, [0.0; 3], [0.0, 9.0, 0.0]),
            (3.0, [8.0, 0.0, 4.0], [0.0, 9.0, 0.0]),
            (5.0, [8.0, 6.0, 0.0], [1.0; 3]),
        ];
        for interpolation in [Interpolation::Linear, Interpolation::Smooth, Interpolation::Step] {
            let path = linear(&three, interpolation);
            assert_eq!(path.frames(), 30);
            for (frame, (_, eye, target)) in
                [0, 10, 30, 99].into_iter().zip([three[0], three[1], three[2], three[2]])
            {
                let camera = path.camera(frame).unwrap();
                assert_eq!(
                    (camera.eye(), camera.target()),
                    (eye.into(), target.into()),
                    "{interpolation:?} {frame}"
                );
            }
        }
        assert_eq!(linear(&three, Interpolation::Linear).camera(5).unwrap().eye(), DVec3::new(4.0, 0.0, 2.0));
        assert_eq!(linear(&three, Interpolation::Step).camera(9).unwrap().eye(), DVec3::ZERO);
        // Smooth: the speed just before a keyframe is that just after.
        let path = linear(&three, Interpolation::Smooth);
        let [a, b, c] = [0.999, 1.0, 1.001].map(|t| path.at(t).eye);
        assert!(((b - a) - (c - b)).length() < 1e-4, "{a} {b} {c}");
        // Even steps stay even.
        let even = [
            (0.0, [0.0; 3], [0.0, 9.0, 0.0]),
            (1.0, [1.0; 3], [0.0, 9.0, 0.0]),
            (3.0, [3.0; 3], [0.0, 9.0, 0.0]),
        ];
        assert_eq!(
            path_steps(&linear(&even, Interpolation::Smooth)),
            path_steps(&linear(&even, Interpolation::Linear))
        );
    }

    fn path_steps(path: &CameraPath) -> Vec<i64> {
        eyes(path).windows(2).map(|w| ((w[1] - w[0]).length() * 1e4).round() as i64).collect()
    }

    #[test]
    fn frames_are_spread_evenly() {
        let path = PathKind::Turn.path(&STAGE, 0).unwrap();
        assert_eq!(path.frames(), 1200);
        assert_eq!(path.spread(4).collect::<Vec<_>>(), [0, 300, 600, 900]);
        assert_eq!(path.spread(1).collect::<Vec<_>>(), [0]);
        assert_eq!(path.spread(0).len(), 0);
        assert!(path.spread(1200).eq(0..1200) && path.spread(5000).eq(0..1200));
        let odd: Vec<_> = path.spread(7).collect();
        assert!(odd.windows(2).all(|w| (171..=172).contains(&(w[1] - w[0]))), "{odd:?}");
        let view = CameraPath::view(&path.camera(3).unwrap());
        assert_eq!((view.frames(), view.camera(0).unwrap().eye()), (1, path.camera(3).unwrap().eye()));
    }

    #[test]
    fn comes_back_from_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let camera = Camera::looking(DVec3::new(0.1, 1.0 / 3.0, 7e6), [12.0, -3.0], Projection::default());
        let mut paths = vec![CameraPath::view(&camera.unwrap()).named("\"Straße\" 1")];
        paths.extend(PathKind::ALL.map(|kind| kind.path(&STAGE, 7).unwrap()));
        let flat = Projection::Orthographic { units_per_pixel: 0.1 };
        paths.push(CameraPath::new(paths[7].keyframes.clone(), flat, 29.97, Interpolation::Step).unwrap());
        for (k, path) in paths.into_iter().enumerate() {
            let file = folder.path().join(format!("{k}.json"));
            path.write(&file).unwrap();
            assert!(path.write(&file).unwrap_err().to_string().contains("there is a file of that name"));
            let read = CameraPath::read(&file).unwrap();
            assert_eq!(read, path);
            assert_eq!(read.camera(31), path.camera(31));
        }
    }

    #[test]
    fn what_is_wrong_is_named_with_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.json");
        let good = r#"{"time": 0, "eye": [0, 0, 9], "target": [0, 9, 0]}"#;
        let cases = [
            ("", "a.json: line 1, column 0: EOF while parsing a value"),
            ("{\"version\": 1,\n \"keyframes\": [}", "a.json: line 2, column 16: expected value"),
            (
                r#"{"version": 2, "view": {}}"#,
                "a.json: version is 2: this program reads camera paths of version 1",
            ),
            (r#"{"keyframes": []}"#, "a.json: line 1, column 17: missing field `version`"),
            (r#"{"version": 1, "keyframes": []}"#, "a.json: keyframes: there is none"),
            (
                "{\"version\": 1,\n  \"colour\": 3}",
                "a.json: line 2, column 10: unknown field `colour`, expected one of",
            ),
            (
                r#"{"version": 1, "fps": 0, "keyframes": [GOOD]}"#,
                "a.json: fps is 0: it must be finite and above 0",
            ),
            (r#"{"version": 1, "fps": 1e999, "keyframes": [GOOD]}"#, "column 27: number out of range"),
            (r#"{"version": 1, "keyframes": [GOOD, GOOD]}"#, "a.json: keyframe 2: time 0 is not after 0"),
            (
                r#"{"version": 1, "keyframes": [GOOD, {"time": 1e9, "eye": [0, 0, 9], "target": [0, 9, 0]}]}"#,
                "a.json: the path has 60000000000 frames",
            ),
            (
                r#"{"version": 1, "keyframes": [GOOD, {"time": 1, "eye": [0, 0, 9], "angles": {"azimuth": 0, "elevation": 3}}]}"#,
                "a.json: keyframe 2: a path has a target in each keyframe, or angles in each",
            ),
            (
                "{\"version\": 1, \"keyframes\": [GOOD,\n{\"time\": 1, \"eye\": [0, 0, 9]}]}",
                "line 2, column 30: keyframe: `target` or `angles` is missing",
            ),
            (
                "{\"version\": 1, \"keyframes\": [\n{\"time\": 1, \"eye\": [0, 0, 9], \"target\": [0, 0, 9]}]}",
                "line 2, column 51: keyframe: eye and target are both at 0,0,9",
            ),
            (
                "{\"version\": 1, \"keyframes\": [\n{\"time\": 1, \"eye\": [0, 0], \"target\": [0, 0, 9]}]}",
                "line 2, column 25: invalid length 2",
            ),
            (
                r#"{"version": 1, "projection": {"fov": 180}, "keyframes": [GOOD]}"#,
                "column 41: projection: field of view is 180°",
            ),
            (
                r#"{"version": 1, "projection": {"fov": 1, "units_per_pixel": 1}, "keyframes": [GOOD]}"#,
                "not both",
            ),
            (
                r#"{"version": 1, "interpolation": "fast", "keyframes": [GOOD]}"#,
                "unknown variant `fast`, expected one of `linear`, `smooth`, `step`",
            ),
        ];
        for (text, says) in cases {
            std::fs::write(&file, text.replace("GOOD", good)).unwrap();
            let error = CameraPath::read(&file).unwrap_err().to_string();
            assert!(error.contains(says), "{text}\n{error}\nnot: {says}");
            assert!(error.starts_with(file.to_str().unwrap()), "{error}");
        }
        let missing = CameraPath::read(&folder.path().join("no.json")).unwrap_err().to_string();
        assert!(missing.contains("no.json: cannot be read: "), "{missing}");
    }
}
