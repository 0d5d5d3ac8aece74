//! Names, codes, units and kinds of the coordinate systems of real files.

use lasray::source::LidarFile;
use lasray::source::crs::{self, Crs, CrsKind};
use lasray::source::placement::{FileFacts, PlacementNote, PlacementOptions, World};
use std::path::PathBuf;

/// Real files, which are no part of the repository.
fn data() -> Option<PathBuf> {
    let folder = std::env::var_os("LASRAY_DATA")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data")), PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("skipped: no real files at {} (LASRAY_DATA names another folder)", folder.display());
    None
}

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
        let facts = FileFacts { path: file.path(), crs: crs.as_ref(), points: file.points(), centre, extent };
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
