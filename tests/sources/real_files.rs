//! Real files: the points are those that the `las` crate reads, and bad files give what can be had.

use crate::made::{append, columns, data_dir, decode_all, las_crate_files, lidar_files, more_columns};
use lasray::source::{Decoder, Fields, LidarFile, PointBlock};
use std::path::Path;

/// Expects that `path` is sound and that its columns are those of `las`'s raw records.
fn compare(path: &Path) {
    let file = LidarFile::open(path).unwrap();
    assert!(file.warnings.is_empty(), "{}: {:?}", path.display(), file.warnings);
    let mut reader = las::Reader::from_path(path).unwrap();
    let points = reader.read_all().unwrap();
    assert_eq!(file.points(), points.len() as u64);
    let mut decoder = Decoder::default();
    for chunk in &file.chunks {
        let mut all = PointBlock::default();
        decoder.decode(&file, chunk, 0..u64::MAX, &mut |block| append(&mut all, block)).unwrap();
        let len = points.record_len();
        let range = chunk.first_record as usize..(chunk.first_record + chunk.records) as usize;
        let raw = &points.raw_bytes()[range.start * len..range.end * len];
        assert!(all == columns(file.header.format, len, raw), "{}: {chunk:?}", path.display());
        let (mut ids, mut angles, mut times) = (Vec::<u16>::new(), Vec::<i16>::new(), Vec::<u64>::new());
        let mut decoder = Decoder::default();
        decoder.set_fields(Fields::ALL);
        let mut take = |block: &PointBlock| {
            ids.extend(&block.source_id);
            angles.extend(&block.scan_angle);
            times.extend(block.gps_time.iter().map(|time| time.to_bits()));
        };
        decoder.decode(&file, chunk, 0..u64::MAX, &mut take).unwrap();
        let more = more_columns(file.header.format, len, raw);
        assert!((ids, angles, times) == more, "{}: {chunk:?}", path.display());
    }
}

#[test]
fn good_files_equal_the_las_crate() {
    for path in las_crate_files() {
        compare(&path);
    }
    let Some(dir) = data_dir() else { return };
    let mut compared = 0;
    for path in lidar_files(&dir) {
        let name = path.strip_prefix(&dir).unwrap();
        if !["hostile", "odd", "reports"].iter().any(|folder| name.starts_with(folder)) {
            compare(&path);
            compared += 1;
        }
    }
    assert!(compared > 40, "{compared}");
}

#[test]
fn pairs_hold_the_same_points() {
    let Some(dir) = data_dir() else { return };
    let pairs = [
        ("autzen/autzen_trim.las", "autzen/autzen_trim.laz"),
        ("versions/point10.las", "versions/point10.laz"),
        ("versions/point-color.las", "versions/point-color.laz"),
        ("versions/point-time.las", "versions/point-time.laz"),
        ("versions/point-time-color.las", "versions/point-time-color.laz"),
        ("versions/10_points_format_0.las", "versions/10_points_format_0.laz"),
        ("versions/10_points_format_3.las", "versions/10_points_format_3.laz"),
        ("versions/10_points_format_5.las", "versions/10_points_format_5.laz"),
        ("versions/10_points_format_6.las", "versions/10_points_format_6.laz"),
        ("versions/10_points_format_7.las", "versions/10_points_format_7.laz"),
        ("versions/10_points_format_8.las", "versions/10_points_format_8.laz"),
    ];
    let read = |name: &str| decode_all(&LidarFile::open(&dir.join(name)).unwrap()).0;
    for (las, laz) in pairs {
        assert!(read(las) == read(laz), "{las} {laz}");
    }
    // The same points in formats 3 and 7, and in another order.
    let (three, seven) = (read("autzen/autzen_trim.las"), read("autzen/autzen_trim_7.las"));
    assert_eq!((three.x, three.y, three.z, three.rgb), (seven.x, seven.y, seven.z, seven.rgb));
    let sorted = |block: PointBlock| {
        let mut points: Vec<_> = (0..block.len())
            .map(|i| {
                let xyz = (block.x[i], block.y[i], block.z[i]);
                (xyz, block.class[i], block.intensity[i], block.returns[i])
            })
            .collect();
        points.sort_unstable();
        points
    };
    let in_units = |name: &str| {
        let header = LidarFile::open(&dir.join(name)).unwrap().header;
        (header.scale, header.offset)
    };
    let (plain, copc) = ("urban/fusa.laz", "copc/fusa.copc.laz");
    if in_units(plain) == in_units(copc) {
        assert!(sorted(read(plain)) == sorted(read(copc)));
    } else {
        let count = |name| sorted(read(name)).len();
        assert_eq!(count(plain), count(copc));
    }
}

/// What a bad file must give: points, and words of its error or of its warnings and chunk errors in order.
const BAD: &[(&str, usize, &[&str])] = &[
    ("hostile/base_ok_1.2.las", 3000, &[]),
    ("hostile/bounds_nan.las", 3000, &["header byte 179: bounds are not finite"]),
    (
        "hostile/count_too_big.las",
        3000,
        &["claims 4294967295 points, 3000 can be read, 4294964295 are missing"],
    ),
    ("hostile/data_offset_past_eof.las", 0, &["header byte 96: offset to point data is "]),
    ("hostile/empty_file.las", 0, &["empty_file.las: empty file"]),
    ("hostile/flat_plane.laz", 3000, &[]),
    ("hostile/one_point.laz", 1, &[]),
    ("hostile/outlier_xyz.las", 3000, &[]),
    ("hostile/pdrf_63.las", 0, &["header byte 104: point format is 63"]),
    (
        "hostile/scale_zero.las",
        0,
        &["scale_zero.las: header byte 131: X scale is 0, must be above 0 and at most 1e6"],
    ),
    ("hostile/trunc_mid_chunk.laz", 1398, &["byte 531: chunk table", "end early (1398 of 3000 points read)"]),
    ("hostile/trunc_mid_record.las", 1500, &["3000 points, 1500 can be read, 1500 are missing"]),
    ("hostile/vlr_count_huge.las", 3000, &["2 of 4294967295 variable length records read"]),
    ("odd/1.2-empty-geotiff-vlrs.las", 43, &[]),
    ("odd/autzen-dd.las", 1065, &[]),
    ("odd/bad-geotiff-keys.las", 10, &[]),
    ("odd/bad_vlr_count.las", 10, &["2 of 3 variable length records read"]),
    ("odd/broken_coder.laz", 0, &["byte 281: LASzip record: coder is 15"]),
    ("odd/broken_compressor.laz", 0, &["compressor is 16"]),
    ("odd/broken_size.laz", 0, &["item Point10 has version 6"]),
    ("odd/broken_type.laz", 0, &["Item with type code: 22 is unknown"]),
    ("odd/epsg_4326.las", 5380, &[]),
    ("odd/garbage_nVariableLength.las", 718, &["0 of 1069128089 variable", "719 points, 718 can be read"]),
    ("odd/gps-time-nan.las", 1, &[]),
    ("odd/lots_of_vlr.las", 1, &[]),
    ("odd/mvk-thin.las", 6280, &[]),
    ("odd/no-points.las", 0, &[]),
    ("odd/noise-dirty.las", 1065, &[]),
    ("odd/spurious.las", 1065, &[]),
];

#[test]
fn bad_files_give_what_can_be_had() {
    let Some(dir) = data_dir() else { return };
    let base = decode_all(&LidarFile::open(&dir.join("hostile/base_ok_1.2.las")).unwrap()).0;
    for &(name, points, words) in BAD {
        let mut told = Vec::new();
        let mut all = PointBlock::default();
        match LidarFile::open(&dir.join(name)) {
            Err(error) => told.push(error.to_string()),
            Ok(file) => {
                told.extend(file.warnings.iter().map(ToString::to_string));
                let (block, errors) = decode_all(&file);
                told.extend(errors.iter().map(ToString::to_string));
                all = block;
            }
        }
        assert_eq!(all.len(), points, "{name}: {told:?}");
        assert_eq!(told.len(), words.len(), "{name}: {told:?}");
        for (told, words) in told.iter().zip(words) {
            assert!(told.contains(words), "{name}: {told}");
        }
        if name.starts_with("hostile/trunc") {
            assert_eq!((&all.x[..], &all.class[..]), (&base.x[..points], &base.class[..points]));
        }
    }
    for folder in ["hostile", "odd"] {
        for path in lidar_files(&dir.join(folder)) {
            let name = path.strip_prefix(&dir).unwrap().to_string_lossy().replace('\\', "/");
            assert!(BAD.iter().any(|b| b.0 == name), "{name} has no expectation");
        }
    }
}

#[test]
fn files_of_another_kind_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let open = |name: &str, bytes: &[u8]| {
        let path = dir.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        LidarFile::open(&path).unwrap_err().to_string()
    };
    assert!(open("text.las", b"x y z\n1 2 3\n").ends_with("starts with \"x y \" instead of \"LASF\""));
    assert!(open("short.las", b"LA").contains("ends inside its header: 2 bytes"));
    let cut = open("cut.las", &[b"LASF".as_slice(), &[0; 20], &[1, 4], &[0; 300]].concat());
    assert!(cut.ends_with("ends inside its header: 326 bytes, a LAS 1.4 header has 375"), "{cut}");
    let new = open("new.las", &[b"LASF".as_slice(), &[0; 20], &[2, 0], &[0; 300]].concat());
    assert!(new.ends_with("header byte 24: version is 2.0, not one of 1.0 to 1.4"), "{new}");
    assert!(LidarFile::open(dir.path()).unwrap_err().to_string().contains("not a regular file"));
    let missing = LidarFile::open(&dir.path().join("not there.laz")).unwrap_err().to_string();
    assert!(missing.contains("not there.laz: cannot open"), "{missing}");
}
