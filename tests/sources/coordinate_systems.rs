//! Names, codes, units and kinds of the coordinate systems of real files.

use crate::scene::real_files as data;
use glam::DVec3;
use lasray::sample;
use lasray::source::crs::{self, Crs, CrsKind};
use lasray::source::placement::{FileFacts, Fit, PlacementNote, PlacementOptions, World};
use lasray::source::reproject::Reprojection;
use lasray::source::{LidarFile, inputs};
use lasray::synth::{self, Tile};
use std::path::{Path, PathBuf};

fn read(file: &LidarFile) -> Option<Crs> {
    let (crs, errors) = crs::of_file(file).unwrap();
    assert!(errors.is_empty(), "{}: {errors:?}", file.path().display());
    crs
}

#[test]
fn real_files() {
    let Some(data) = data() else { return };
    use CrsKind::{Geocentric, Geographic, Projected};
    // File, name, EPSG code, kind, horizontal and vertical unit.
    let cases = [
        ("autzen/autzen_trim.las", "NAD_1983_HARN_Lambert_Conformal_Conic", None, Projected, "ft", None),
        ("autzen/autzen_trim_7.las", "NAD_1983_HARN_Lambert_Conformal_Conic", None, Projected, "ft", None),
        (
            "autzen/autzen_test.copc.laz",
            "NAD83 / Oregon GIC Lambert (ft) + NAVD88 height (ftUS)",
            Some(2992),
            Projected,
            "ft",
            Some("ftUS"),
        ),
        (
            "copc/1.2-with-color.copc.laz",
            "NAD83 / Oregon LCC (m) + NAVD88 height (ftUS)",
            Some(2991),
            Projected,
            "m",
            Some("ftUS"),
        ),
        ("copc/lone-star.copc.laz", "unnamed geocentric system", None, Geocentric, "m", None),
        ("copc/fusa.copc.laz", "WGS 84 / UTM zone 54S", Some(32754), Projected, "m", None),
        ("urban/fusa.laz", "WGS 84 / UTM zone 54S", Some(32754), Projected, "m", Some("m")),
        ("forest/Megaplot.laz", "NAD83 / UTM zone 17N", Some(26917), Projected, "m", Some("m")),
        (
            "forest/multitile_bcts/bcts_1.laz",
            "NAD83 / BC Albers + CGVD28",
            Some(3005),
            Projected,
            "m",
            Some("m"),
        ),
        ("water/Topography.laz", "NAD83(CSRS) / MTM zone 7", Some(2949), Projected, "m", None),
        ("water/corse.laz", "RGF93 / Lambert-93", Some(2154), Projected, "m", None),
        ("rgb/red-rocks-merged.laz", "NAD83 / UTM zone 13N", Some(26913), Projected, "m", None),
        ("versions/1.0_0.las", "NAD83 / UTM zone 15N", Some(26915), Projected, "m", None),
        (
            "versions/test1_4.las",
            "NAD83(HARN) / New Mexico Central (ftUS) + North American Vertical Datum of 1988",
            Some(2903),
            Projected,
            "ftUS",
            Some("ftUS"),
        ),
        ("odd/autzen-dd.las", "WGS 84", Some(4326), Geographic, "°", None),
        ("odd/no-points.las", "NAD83", Some(4269), Geographic, "°", None),
        ("odd/bad-geotiff-keys.las", "WGS 84 / UTM zone 17N", Some(32617), Projected, "m", None),
        (
            "odd/mvk-thin.las",
            "NAD83 / Mississippi West (ftUS) + NAVD88 - Geoid03 (Feet)",
            Some(2255),
            Projected,
            "ftUS",
            Some("ftUS"),
        ),
        ("odd/lots_of_vlr.las", "unnamed projected system", None, Projected, "ftUS", None),
    ];
    for (path, name, epsg, kind, horizontal, vertical) in cases {
        let crs = read(&LidarFile::open(&data.join(path)).unwrap()).unwrap_or_else(|| panic!("{path}: none"));
        assert_eq!((crs.name.as_str(), crs.epsg, crs.kind), (name, epsg, kind), "{path}");
        assert_eq!(crs.horizontal_unit.symbol(), horizontal, "{path}");
        assert_eq!(crs.vertical_unit.as_ref().map(|unit| unit.symbol()), vertical, "{path}");
        if epsg.is_some() {
            let prj = crs.prj().unwrap();
            assert!(prj.starts_with("PROJCS[") || prj.starts_with("GEOGCS["), "{path}: {prj}");
            assert!(!prj.contains("COMPD_CS") && !prj.contains("VERT_CS"), "{path}: {prj}");
        }
    }
    for path in [
        "autzen/autzen-thin.las",
        "odd/1.2-empty-geotiff-vlrs.las",
        "urban/multitile_delft/ahn3_cropped_1.laz",
    ] {
        assert_eq!(read(&LidarFile::open(&data.join(path)).unwrap()), None, "{path}");
    }
}

#[test]
fn real_files_are_placed_as_their_system_asks() {
    let Some(data) = data() else { return };
    let place = |path: &str| {
        let file = LidarFile::open(&data.join(path)).unwrap();
        let crs = read(&file);
        let centre = (file.header.min + file.header.max) / 2.0;
        let extent = file.header.max - file.header.min;
        let facts = FileFacts {
            path: file.path(),
            crs: crs.as_ref(),
            points: file.points(),
            centre,
            extent,
            step: 0.01,
        };
        let world = World::of(&[facts], &PlacementOptions::default());
        let placement = world.placements[0].clone().unwrap();
        (placement.place(centre.x, centre.y, centre.z), placement.is_identity(), world.notes)
    };
    let (_, identity, notes) = place("copc/lone-star.copc.laz");
    assert!(identity && matches!(notes[..], [PlacementNote::NotGeocentric { .. }]), "{notes:?}");
    let (middle, _, notes) = place("odd/autzen-dd.las");
    assert_eq!(notes, [PlacementNote::Degrees { latitude: 44.0 }]);
    assert!(middle.x < -9.8e6 && middle.y > 4.8e6, "{middle}");
    // 128 m by the US survey foot: 420 ft or so above the sea in Eugene, Oregon.
    let (middle, identity, notes) = place("copc/1.2-with-color.copc.laz");
    assert!(!identity && matches!(notes[..], [PlacementNote::HeightUnit { .. }]), "{notes:?}");
    assert!((100.0..200.0).contains(&middle.z), "{middle}");
    let (_, identity, notes) = place("autzen/autzen_test.copc.laz");
    assert!(identity && notes.is_empty(), "{notes:?}");
}

/// Takes the opening sample of files.
fn world_of(paths: &[PathBuf], options: &PlacementOptions) -> World {
    let opened: Vec<_> = sample::open_all(paths).into_iter().map(Result::unwrap).collect();
    sample::take(&opened, options, &sample::Asked::default(), &sample::SampleBudget::default()).world
}

/// Small files after what people reported of other programs.
#[test]
fn files_of_one_system_under_several_names_are_one_world() {
    let Some(data) = data() else { return };
    for pair in ["crs_two_ways", "pairs/etrs_names", "pairs/nad_esri", "pairs/unnamed"] {
        let folder = data.join("reports").join(pair);
        let files = inputs::expand([&folder]).files;
        assert_eq!(files.len(), 2, "{pair}");
        let world = world_of(&files, &PlacementOptions::default());
        assert!(world.notes.is_empty(), "{pair}: {:?}", world.notes);
        assert!(world.placements.iter().flatten().all(|placement| placement.is_identity()), "{pair}");
        assert_eq!(world.placements.iter().flatten().count(), 2, "{pair}");
    }
}

#[test]
fn reported_files_are_placed_as_they_are_meant() {
    let Some(data) = data() else { return };
    let place = |name: &str| world_of(&[data.join("reports").join(name)], &PlacementOptions::default());
    let degrees = place("degrees_no_crs.laz");
    assert!(matches!(degrees.notes[0], PlacementNote::Recognised { files: 1, .. }), "{:?}", degrees.notes);
    assert!(matches!(degrees.base, Fit::Scaled(_)) && degrees.unit.unwrap().name == "metre");
    let ecef = place("ecef_no_crs.laz");
    assert!(matches!(ecef.notes[0], PlacementNote::Recognised { files: 1, .. }), "{:?}", ecef.notes);
    assert!(matches!(ecef.base, Fit::Turned { .. }));
    let web = place("webmercator60.laz");
    assert!(matches!(web.notes[..], [PlacementNote::Stretched { .. }]), "{:?}", web.notes);
    let Fit::Scaled(factor) = web.base else { panic!("{:?}", web.base) };
    assert!((factor.x - 0.501).abs() < 0.01 && factor.z == 1.0, "{factor}");
    // The stray bracket hides neither the feet nor the metres of height.
    let [stray, good] = ["wkt_extra_bracket.laz", "wkt_good_bracket.laz"].map(place);
    assert_eq!((&stray.unit, &stray.placements), (&good.unit, &good.placements));
    assert_eq!(stray.unit.unwrap().symbol(), "ftUS");
}

/// A part of the synthetic town: world coordinates and classes.
fn town_points(corner: [f64; 2], size: [f64; 2], per_square_metre: f64) -> Vec<(DVec3, u8)> {
    let tile = Tile { corner, size, points: (size[0] * size[1] * per_square_metre) as u64 };
    let mut points = Vec::new();
    synth::scan(&synth::Town::new(1), &tile, |scan| {
        let p = &scan.points;
        points.extend((0..p.len()).map(|i| {
            let [x, y, z] = [p.x[i], p.y[i], p.z[i]].map(|v| f64::from(v) * synth::SCALE);
            (DVec3::new(x + synth::ORIGIN[0], y + synth::ORIGIN[1], z), p.class[i])
        }));
        Ok::<(), std::convert::Infallible>(())
    })
    .unwrap();
    points
}

/// What a file says of its coordinate system.
#[derive(Clone, Copy)]
enum Says<'a> {
    Key(u16),
    Wkt(&'a str),
}

/// A LAS or LAZ file of points, in steps of 0.1 mm or 1e-9 degrees.
fn write(path: &Path, points: &[(DVec3, u8)], says: Says, step: f64) {
    let mut builder = las::Builder::from((1, 4));
    builder.point_format = las::point::Format::new(6).unwrap();
    builder.point_format.is_compressed = path.extension().is_some_and(|e| e == "laz");
    let vlr = |record_id, data| las::Vlr {
        user_id: "LASF_Projection".into(),
        record_id,
        description: String::new(),
        data,
    };
    match says {
        Says::Key(code) => {
            let words = [1u16, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, code];
            builder.vlrs.push(vlr(34735, words.into_iter().flat_map(u16::to_le_bytes).collect()));
        }
        Says::Wkt(text) => builder.vlrs.push(vlr(2112, text.as_bytes().to_vec())),
    }
    let middle = points[points.len() / 2].0.round();
    builder.transforms = las::Vector {
        x: las::Transform { scale: step, offset: middle.x },
        y: las::Transform { scale: step, offset: middle.y },
        z: las::Transform { scale: 0.001, offset: 0.0 },
    };
    let mut writer = las::Writer::from_path(path, builder.into_header().unwrap()).unwrap();
    for (at, class) in points {
        let point = las::Point {
            x: at.x,
            y: at.y,
            z: at.z,
            classification: las::point::Classification::new(*class).unwrap(),
            return_number: 1,
            number_of_returns: 1,
            gps_time: Some(0.0),
            ..Default::default()
        };
        writer.write_point(point).unwrap();
    }
    writer.close().unwrap();
}

const ESRI_UTM_32: &str = r#"PROJCS["ETRS_1989_UTM_Zone_32N",GEOGCS["GCS_ETRS_1989",DATUM["D_ETRS_1989",SPHEROID["GRS_1980",6378137.0,298.257222101]],PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],PARAMETER["False_Easting",500000.0],PARAMETER["False_Northing",0.0],PARAMETER["Central_Meridian",9.0],PARAMETER["Scale_Factor",0.9996],PARAMETER["Latitude_Of_Origin",0.0],UNIT["Meter",1.0]]"#;

fn reprojection(from: u16, to: u16, near: DVec3) -> Reprojection {
    let system = |code| crs::definition(code).unwrap().system.unwrap();
    Reprojection::between(&system(from), &system(to), near).unwrap()
}

fn lasray(folder: &Path, words: &[&str]) -> (bool, String) {
    let ran = std::process::Command::new(env!("CARGO_BIN_EXE_lasray"))
        .args(words)
        .current_dir(folder)
        .env("LASRAY_CACHE", folder.join("cache"))
        .output()
        .unwrap();
    (ran.status.success(), String::from_utf8_lossy(&ran.stderr).into_owned())
}

/// Class of every pixel of an EXR.
fn classes(path: &Path) -> Vec<u32> {
    let image = exr::prelude::read_first_flat_layer_from_file(path).unwrap();
    let class = image.layer_data.channel_data.list.into_iter().find(|c| c.name.eq_case_insensitive("class"));
    match class.unwrap().sample_data {
        exr::prelude::FlatSamples::U32(values) => values,
        other => panic!("{other:?}"),
    }
}

/// Strips of one town, each in a system or under a name of its own, beside all of it in one file.
#[test]
fn tiles_of_several_systems_are_one_world_without_a_seam() {
    let folder = tempfile::tempdir().unwrap();
    let (strips, one) = (folder.path().join("strips"), folder.path().join("one"));
    for folder in [&strips, &one] {
        std::fs::create_dir(folder).unwrap();
    }
    let points = town_points([0.0, 0.0], [180.0, 90.0], 8.0);
    let third = |k: usize| -> Vec<_> {
        let west = synth::ORIGIN[0] + 60.0 * k as f64;
        points.iter().filter(|(p, _)| (west..west + 60.0).contains(&p.x)).copied().collect()
    };
    let to_33 = reprojection(25832, 25833, points[0].0);
    let other: Vec<_> = third(1).into_iter().map(|(p, class)| (to_33.point(p), class)).collect();
    write(&strips.join("a.laz"), &third(0), Says::Key(25832), 1e-4);
    write(&strips.join("b.laz"), &other, Says::Key(25833), 1e-4);
    write(&strips.join("c.las"), &third(2), Says::Wkt(ESRI_UTM_32), 1e-4);
    write(&one.join("all.laz"), &points, Says::Key(25832), 1e-4);
    let south_west = (synth::ORIGIN[0] + 5.0, synth::ORIGIN[1] + 5.0);
    let (east, north) = (south_west.0 + 85.0, south_west.1 + 40.0);
    let (eye, target) = (format!("{east},{north},400"), format!("{east},{north},0"));
    for detail in ["0", "1"] {
        let mut pictures = Vec::new();
        for inputs in ["strips", "one"] {
            let out = format!("{inputs}.exr");
            let view = ["--eye", &eye, "--target", &target, "--ortho", "0.5", "--size", "320x160"];
            let rest = ["--cell", "0.5", "--shade", "none", "--color", "class", "--detail", detail];
            let words = [&["render", inputs, "-o", &out][..], &view, &rest].concat();
            let (done, said) = lasray(folder.path(), &words);
            assert!(done, "{said}");
            assert!(
                inputs == "one" || said.contains("1 file in ETRS89 / UTM zone 33N is transformed"),
                "{said}"
            );
            assert!(!said.contains("left out"), "{said}");
            pictures.push(classes(&folder.path().join(out)));
        }
        // A column of pixels along each border, and all.
        let differ = |x: std::ops::Range<usize>| {
            let at = |y: usize| x.clone().map(move |x| y * 320 + x);
            let all: Vec<_> = (0..160).flat_map(at).collect();
            all.iter().filter(|&&at| pictures[0][at] != pictures[1][at]).count() as f64 / all.len() as f64
        };
        // What lies within 0.2 mm of a cell's border may be beyond it: one point in a thousand.
        assert!(differ(0..320) < 0.004, "{} of the pixels differ", differ(0..320));
        for border in [(60.0 - 5.0) / 0.5, (120.0 - 5.0) / 0.5] {
            let x = border as usize;
            assert!(differ(x - 4..x + 4) < 0.01, "at a border {}", differ(x - 4..x + 4));
        }
    }
}

/// Bounds of chunks are learned as the file has them: of a file of another system they say where chunks lie in the
/// world's, to the last one at the edge.
#[test]
fn a_chunk_at_the_edge_of_a_transformed_tile_is_never_missed() {
    let folder = tempfile::tempdir().unwrap();
    // Far from its central meridian a zone's north is turned by degrees: chunks' boxes are wider in the other zone.
    let shift = DVec3::new(250_000.0, 0.0, 0.0);
    let points: Vec<_> = town_points([0.0, 0.0], [400.0, 120.0], 8.0)
        .into_iter()
        .map(|(p, class)| (p + shift, class))
        .collect();
    let to_33 = reprojection(25832, 25833, points[0].0);
    let west: Vec<_> = points.iter().filter(|(p, _)| p.x < points[0].0.x + 20.0).copied().collect();
    let east: Vec<_> = points.iter().map(|(p, class)| (to_33.point(*p), *class)).collect();
    write(&folder.path().join("east.las"), &east, Says::Key(25833), 1e-3);
    write(&folder.path().join("west.laz"), &west, Says::Key(25832), 1e-3);
    let middle = points.iter().map(|(p, _)| *p).sum::<DVec3>() / points.len() as f64;
    let run = |out: &str, more: &[&str], at: DVec3| {
        let (eye, target) =
            (format!("{},{},{}", at.x, at.y - 60.0, 90.0), format!("{},{},{}", at.x, at.y, 5.0));
        let words = ["render", "east.las", "west.laz", "--crs", "EPSG:25832", "--color", "class", "-o", out];
        let view =
            ["--eye", &eye, "--target", &target, "--size", "160x90", "--shade", "none", "--cell", "0.5"];
        let (done, said) = lasray(folder.path(), &[&words[..], &view, more].concat());
        assert!(done, "{said}");
        classes(&folder.path().join(out))
    };
    let mut hit = 0;
    for along in [-200.0, -120.0, 0.0, 130.0, 195.0] {
        for across in [-55.0, 50.0] {
            let at = middle + DVec3::new(along, across, 0.0);
            // Everything is read; only what is seen, once without and once with what was learned.
            let all = run("all.exr", &["--no-cache"], at);
            let fresh = run("fresh.exr", &["--detail", "0.01", "--no-cache"], at);
            let learned = run("learned.exr", &["--detail", "0.01"], at);
            assert!(all == fresh, "{at}: what is seen lacks something");
            assert!(all == learned, "{at}: with learned bounds something is missing");
            hit += all.iter().filter(|&&class| class != 256).count();
        }
    }
    assert!(hit > 20_000, "{hit}");
}

/// The opening sample does not see a large file's edges: nothing of it may be missing there for all that.
#[test]
fn a_transformed_file_is_drawn_to_its_edges() {
    let folder = tempfile::tempdir().unwrap();
    let points = town_points([0.0, 0.0], [380.0, 380.0], 2.2);
    assert!(points.len() > 300_000, "more than is sampled whole");
    write(&folder.path().join("a.laz"), &points, Says::Key(25832), 1e-3);
    let (east, north) = (synth::ORIGIN[0] + 190.0, synth::ORIGIN[1] + 190.0);
    let (eye, target) = (format!("{east},{north},900"), format!("{east},{north},0"));
    let mut pictures = Vec::new();
    // Other names for one datum, without a shift: a file of another system, whose coordinates stay.
    for (out, more) in [("own.exr", &[][..]), ("transformed.exr", &["--crs", "EPSG:32632"][..])] {
        let words = ["render", "a.laz", "-o", out, "--ortho", "2", "--size", "210x210", "--cell", "0.5"];
        let view = ["--eye", &eye, "--target", &target, "--detail", "1", "--color", "class"];
        let (done, said) = lasray(folder.path(), &[&words[..], &view, more].concat());
        assert!(done && (more.is_empty() || said.contains("is transformed")), "{said}");
        pictures.push(classes(&folder.path().join(out)));
    }
    let differ = pictures[0].iter().zip(&pictures[1]).filter(|(a, b)| a != b).count();
    assert!(differ < 40, "{differ} of {} pixels differ", pictures[0].len());
}

/// Against PROJ's own `cs2cs` (Debian: proj-bin), where it is installed: to a centimetre where the datum stays or its
/// shift is null, else within the operation's stated accuracy. `scripts/check-transforms.sh` installs it.
#[test]
fn points_come_to_where_cs2cs_puts_them() {
    let found = std::process::Command::new("cs2cs").output().is_ok();
    if !found {
        assert!(std::env::var_os("LASRAY_CS2CS").is_none(), "cs2cs is not there");
        println!("skipped: no cs2cs (Debian: proj-bin)");
        return;
    }
    // From, to, longitude and latitude of the middle; first where the datum stays or its shift is null.
    let exact = [
        (25832, 25833, [10.5, 51.0]),
        (25833, 25832, [12.5, 48.0]),
        (32632, 32633, [11.0, 47.0]),
        (32633, 25832, [12.0, 50.0]),
        (2154, 25832, [6.5, 45.0]),
        (3945, 2154, [4.0, 45.2]),
        (26910, 26911, [-120.0, 45.0]),
        (2992, 26910, [-123.1, 44.0]),
        (2991, 2992, [-122.0, 44.5]),
        (3005, 26910, [-123.5, 49.3]),
        (26917, 2949, [-72.0, 47.0]),
        (3857, 32632, [9.2, 48.8]),
        (3395, 32632, [9.2, 48.8]),
        (4326, 25832, [9.2, 48.8]),
        (25832, 4326, [9.2, 48.8]),
        (4269, 26917, [-80.0, 35.0]),
        (2180, 25834, [19.5, 52.0]),
        (3035, 25833, [13.4, 52.5]),
        (3006, 25833, [15.0, 60.0]),
        (32754, 28354, [140.5, -36.5]),
        (3995, 32633, [15.0, 78.2]),
    ];
    let shifted = [
        (31467, 25832, [9.2, 48.8]),
        (31468, 25832, [11.6, 48.1]),
        (2056, 25832, [8.5, 47.4]),
        (28992, 25832, [6.0, 52.1]),
        (27700, 32630, [-2.0, 53.0]),
        (5514, 25833, [15.0, 50.0]),
        (27572, 2154, [2.4, 47.0]),
    ];
    let cases = exact.iter().map(|case| (case, true)).chain(shifted.iter().map(|case| (case, false)));
    let mut wrong = Vec::new();
    for (&(from, to, [lon, lat]), is_exact) in cases {
        let degrees = crs::definition(4326).unwrap().system.unwrap();
        let system = |code| crs::definition(code).unwrap().system.unwrap_or_else(|| panic!("EPSG:{code}"));
        let near = Reprojection::between(&degrees, &system(from), DVec3::new(lon, lat, 0.0)).unwrap();
        let near = near.point(DVec3::new(lon, lat, 0.0));
        let way = reprojection(from, to, near);
        let step = if system(from).is_geographic() { 0.02 } else { 2000.0 / system(from).unit() };
        let points: Vec<_> = (0..25)
            .map(|k| near + DVec3::new(f64::from(k % 5) - 2.0, f64::from(k / 5) - 2.0, 0.0) * step)
            .collect();
        let text: String = points.iter().map(|p| format!("{:.9} {:.9}\n", p.x, p.y)).collect();
        let out = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(&out, text).unwrap();
        // The old form keeps east before north whatever the register says.
        let ran = std::process::Command::new("cs2cs")
            .args(["-f", "%.10f", &format!("+init=epsg:{from}"), "+to", &format!("+init=epsg:{to}")])
            .arg(out.path())
            .output()
            .unwrap();
        let mut apart: f64 = 0.0;
        let lines = String::from_utf8(ran.stdout).unwrap();
        for (line, at) in lines.lines().zip(&points) {
            let numbers: Vec<f64> = line.split_whitespace().map(|v| v.parse().unwrap_or(f64::NAN)).collect();
            let here = way.point(*at);
            apart = apart.max((here.x - numbers[0]).hypot(here.y - numbers[1]));
        }
        let metres = apart * if system(to).is_geographic() { 111_000.0 } else { system(to).unit() };
        let accuracy = way.accuracy.unwrap_or(0.0);
        println!("EPSG:{from} to {to}: {metres:.4} m apart, {} ({accuracy} m)", way.operation);
        let most = if is_exact { 0.01 } else { accuracy };
        if lines.lines().count() != points.len() || metres.is_nan() || metres > most {
            wrong.push(format!("EPSG:{from} to {to}: {metres} m, {most} are allowed: {}", way.operation));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
