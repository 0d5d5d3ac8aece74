//! Real files, read by lasray and by the `las` crate: same points.
//!
//! Uses the data that the `las` crate's package carries, and `../shared/data` (or `LASRAY_DATA`) where it
//! is there.

use lasray::source::{Decoder, LidarFile, PointBlock, SourceError};
use std::path::{Path, PathBuf};

/// What is compared of a file: counts and wrapping sums of every column.
#[derive(Clone, Debug, Default, PartialEq)]
struct Sums {
    points: u64,
    x: i64,
    y: i64,
    z: i64,
    class: u64,
    flags: [u64; 4],
    intensity: u64,
    returns: [u64; 2],
    rgb: [u64; 3],
}

impl Sums {
    fn add(&mut self, block: &PointBlock) {
        assert!(block.len() <= lasray::source::BLOCK_RECORDS);
        self.points += block.len() as u64;
        self.x += block.x.iter().map(|&v| i64::from(v)).sum::<i64>();
        self.y += block.y.iter().map(|&v| i64::from(v)).sum::<i64>();
        self.z += block.z.iter().map(|&v| i64::from(v)).sum::<i64>();
        self.class += block.class.iter().map(|&v| u64::from(v)).sum::<u64>();
        for (bit, sum) in self.flags.iter_mut().enumerate() {
            *sum += block.flags.iter().filter(|&&f| f >> bit & 1 == 1).count() as u64;
        }
        self.intensity += block.intensity.iter().map(|&v| u64::from(v)).sum::<u64>();
        self.returns[0] += block.returns.iter().map(|&v| u64::from(v & 15)).sum::<u64>();
        self.returns[1] += block.returns.iter().map(|&v| u64::from(v >> 4)).sum::<u64>();
        for (channel, sum) in self.rgb.iter_mut().enumerate() {
            *sum += block.rgb.iter().map(|c| u64::from(c[channel])).sum::<u64>();
        }
    }
}

fn ours(file: &LidarFile) -> (Sums, Vec<SourceError>) {
    let (mut sums, mut errors) = (Sums::default(), Vec::new());
    let mut decoder = Decoder::default();
    for chunk in &file.chunks {
        let mut next = chunk.first_record;
        let result = decoder.decode(file, chunk, 0..u64::MAX, &mut |block| {
            assert_eq!(block.first_record, next);
            next += block.len() as u64;
            sums.add(block);
        });
        errors.extend(result.err());
    }
    (sums, errors)
}

/// The same of `las`'s own columns; class and flags of the raw bytes, for which it has no column.
fn theirs(path: &Path) -> Sums {
    let mut reader = las::Reader::from_path(path).unwrap();
    let points = reader.read_all().unwrap();
    let mut sums = Sums {
        points: points.len() as u64,
        x: points.x_raw().map(i64::from).sum(),
        y: points.y_raw().map(i64::from).sum(),
        z: points.z_raw().map(i64::from).sum(),
        intensity: points.intensity().map(u64::from).sum(),
        returns: [
            points.return_number().map(u64::from).sum(),
            points.number_of_returns().map(u64::from).sum(),
        ],
        ..Sums::default()
    };
    for (r, g, b) in points.rgb().into_iter().flatten() {
        sums.rgb = [sums.rgb[0] + u64::from(r), sums.rgb[1] + u64::from(g), sums.rgb[2] + u64::from(b)];
    }
    for record in points.raw_bytes().chunks_exact(points.record_len()) {
        let (class, flags) = if points.format().is_extended {
            (record[16], record[15] & 15)
        } else {
            (record[15] & 31, record[15] >> 5)
        };
        sums.class += u64::from(class);
        for (bit, sum) in sums.flags.iter_mut().enumerate() {
            *sum += u64::from(flags >> bit & 1);
        }
    }
    sums
}

fn data_dir() -> Option<PathBuf> {
    let dir = std::env::var_os("LASRAY_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    if dir.is_dir() {
        return Some(dir);
    }
    eprintln!("skipped: no real files at {} (set LASRAY_DATA)", dir.display());
    None
}

fn lidar_files(dir: &Path) -> Vec<PathBuf> {
    let is_lidar = |p: &Path| {
        let extension = p.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        extension == "las" || extension == "laz"
    };
    let mut files: Vec<_> = walkdir::WalkDir::new(dir)
        .into_iter()
        .map(|e| e.unwrap().into_path())
        .filter(|p| is_lidar(p))
        .collect();
    files.sort();
    files
}

#[test]
fn good_files_equal_the_las_crate() {
    let Some(dir) = data_dir() else { return };
    let mut compared = 0;
    for path in lidar_files(&dir) {
        let name = path.strip_prefix(&dir).unwrap();
        if name.starts_with("hostile") || name.starts_with("odd") {
            continue;
        }
        let file = LidarFile::open(&path).unwrap();
        let (sums, errors) = ours(&file);
        assert!(errors.is_empty(), "{errors:?}");
        println!(
            "{}: {} points in {} chunks {:?}",
            name.display(),
            sums.points,
            file.chunks.len(),
            file.warnings
        );
        assert_eq!(sums, theirs(&path), "{}", name.display());
        assert_eq!(sums.points, file.header.claimed_points);
        compared += 1;
    }
    assert!(compared > 40, "{compared}");
}
