//! What is known of chunks before they are read: what was learned before, and spatial indices. Both are believed only
//! as far as they can be true.

use crate::lax_writer::Lax;
use crate::made::{Made, Packing};
use lasray::attribute::Flags;
use lasray::ingest::bins::Budget;
use lasray::load::{self, LoadOptions};
use lasray::problems::Problems;
use lasray::section::Surface;
use lasray::source::known::{Known, RawBounds, Told};
use lasray::source::lax::{self, LaxError};
use lasray::source::learned::{Cache, Counts};
use lasray::source::placement::PlacementOptions;
use lasray::source::{Decoder, LidarFile, PointBlock};
use proptest::prelude::*;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// 200,000 points in five chunks.
fn tile(folder: &Path, name: &str) -> LidarFile {
    LidarFile::open(&crate::scene::town(folder, name, [-80.0, -80.0], 160.0)).unwrap()
}

/// The bounds of each chunk, from its points.
fn bounds(file: &LidarFile) -> Vec<Option<RawBounds>> {
    let mut decoder = Decoder::default();
    let of_chunk = |chunk| {
        let mut bounds = RawBounds::NOTHING;
        decoder
            .decode(file, chunk, 0..chunk.records, &mut |block| {
                [&block.x, &block.y, &block.z].into_iter().enumerate().for_each(|(k, v)| bounds.widen(k, v));
            })
            .unwrap();
        Some(bounds)
    };
    file.chunks.iter().map(of_chunk).collect()
}

fn all_of(known: &Known, file: &LidarFile) -> Vec<Option<RawBounds>> {
    file.chunks.iter().map(|chunk| known.of(chunk).map(|(_, bounds)| bounds)).collect()
}

fn entries(folder: &Path) -> Vec<PathBuf> {
    fs::read_dir(folder).map_or(Vec::new(), |found| found.map(|entry| entry.unwrap().path()).collect())
}

#[test]
fn what_was_learned_is_there_again() {
    let folder = tempfile::tempdir().unwrap();
    let file = tile(folder.path(), "a tile.laz");
    let kept = folder.path().join("not yet/there");
    let cache = Cache::at(kept.clone());
    let bounds = bounds(&file);
    assert!(bounds.len() >= 4);
    let nothing = vec![None; bounds.len()];
    assert_eq!(all_of(&cache.load(&file), &file), nothing);
    // Two processes, each of which has learned a part.
    let part =
        |odd: usize| bounds.iter().enumerate().map(|(k, b)| b.filter(|_| k % 2 == odd)).collect::<Vec<_>>();
    cache.save(&file, &part(0)).unwrap();
    assert_eq!(all_of(&cache.load(&file), &file), part(0));
    cache.save(&file, &part(1)).unwrap();
    let known = cache.load(&file);
    assert!(known.is_whole(&file));
    assert_eq!(all_of(&known, &file), bounds);
    assert_eq!(known.of(&file.chunks[1]).unwrap().0, Told::Cache);
    // Nothing new is not written.
    let [entry] = &entries(&kept)[..] else { panic!() };
    let long_ago = SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000);
    fs::File::options().write(true).open(entry).unwrap().set_modified(long_ago).unwrap();
    cache.save(&file, &nothing).unwrap();
    cache.save(&file, &bounds).unwrap();
    assert_eq!(fs::metadata(entry).unwrap().modified().unwrap(), long_ago);
    // Well below a thousandth.
    assert!(fs::metadata(entry).unwrap().len() * 2000 <= file.bytes.len());
    // By any name.
    let same = LidarFile::open(&folder.path().join("./not yet/../a tile.laz")).unwrap();
    assert!(cache.load(&same).is_whole(&same));
    cache.forget(&file);
    assert_eq!(all_of(&cache.load(&file), &file), nothing);
}

#[test]
fn what_was_counted_is_there_again() {
    let folder = tempfile::tempdir().unwrap();
    let file = tile(folder.path(), "tile.laz");
    let kept = folder.path().join("kept");
    let cache = Cache::at(kept.clone());
    let bounds = bounds(&file);
    assert_eq!(cache.load_all(&file).1, Counts::new());
    cache.save(&file, &bounds).unwrap();
    let without = fs::metadata(&entries(&kept)[0]).unwrap().len();
    let counts =
        Counts::from([((0, Flags::NONE), 1), ((2, Flags::WITHHELD), 7), ((255, Flags::ALL), (1 << 52) - 1)]);
    cache.save_all(&file, &[], &counts).unwrap();
    assert_eq!(cache.load_all(&file).1, Counts::new(), "nothing is kept of as many chunks as there are not");
    cache.save_all(&file, &bounds, &counts).unwrap();
    let (known, is) = cache.load_all(&file);
    assert_eq!((all_of(&known, &file), is), (bounds.clone(), counts.clone()));
    let [entry] = &entries(&kept)[..] else { panic!() };
    assert_eq!(fs::metadata(entry).unwrap().len(), without + 24);
    // Bounds alone leave them as they are; others take their place.
    cache.save(&file, &bounds).unwrap();
    assert_eq!(cache.load_all(&file).1, counts);
    let others = Counts::from([((2, Flags::NONE), 9)]);
    cache.save_all(&file, &bounds, &others).unwrap();
    assert_eq!(cache.load_all(&file).1, others);
    // Damaged, there are none.
    let sound = fs::read(entry).unwrap();
    for at in sound.len() - 16..sound.len() {
        let mut bytes = sound.clone();
        bytes[at] ^= 1;
        fs::write(entry, &bytes).unwrap();
        assert_eq!(cache.load_all(&file).1, Counts::new(), "byte {at}");
        fs::write(entry, &sound[..at]).unwrap();
        assert_eq!(cache.load_all(&file).1, Counts::new(), "cut at {at}");
    }
    // More kinds than an entry may take of its file's size are not kept.
    cache.forget(&file);
    let many: Counts = (0..=255).map(|class| ((class, Flags::NONE), 1)).collect();
    cache.save_all(&file, &bounds, &many).unwrap();
    let (known, none) = cache.load_all(&file);
    assert_eq!((all_of(&known, &file), none), (bounds, Counts::new()));
}

#[test]
fn what_was_learned_of_another_file_is_not_believed() {
    let folder = tempfile::tempdir().unwrap();
    let file = tile(folder.path(), "tile.laz");
    let cache = Cache::at(folder.path().join("kept"));
    cache.save(&file, &bounds(&file)).unwrap();
    let path = file.path().to_owned();
    let modified = file.bytes.modified().unwrap();
    let known = || {
        let file = LidarFile::open(&path).unwrap();
        all_of(&cache.load(&file), &file).iter().flatten().count()
    };
    let set_time = |time| fs::File::options().write(true).open(&path).unwrap().set_modified(time).unwrap();
    assert_eq!(known(), file.chunks.len());
    // Another time.
    set_time(modified + Duration::from_nanos(100_000));
    assert_eq!(known(), 0);
    set_time(modified);
    assert_eq!(known(), file.chunks.len());
    // The same time and size, another header: points by return.
    let sound = fs::read(&path).unwrap();
    let mut other = sound.clone();
    other[111] ^= 1;
    fs::write(&path, &other).unwrap();
    set_time(modified);
    assert_eq!(known(), 0);
    // Another path.
    fs::write(&path, &sound).unwrap();
    set_time(modified);
    assert_eq!(known(), file.chunks.len());
    let moved = folder.path().join("moved.laz");
    fs::rename(&path, &moved).unwrap();
    let file = LidarFile::open(&moved).unwrap();
    assert_eq!(file.bytes.modified(), Some(modified));
    assert_eq!(all_of(&cache.load(&file), &file).iter().flatten().count(), 0);
}

#[test]
fn damaged_entries_are_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let file = tile(folder.path(), "tile.laz");
    let kept = folder.path().join("kept");
    let cache = Cache::at(kept.clone());
    cache.save(&file, &bounds(&file)).unwrap();
    let [entry] = &entries(&kept)[..] else { panic!() };
    let sound = fs::read(entry).unwrap();
    let known = || all_of(&cache.load(&file), &file).iter().flatten().count();
    assert_eq!(known(), file.chunks.len());
    for end in 0..sound.len() {
        fs::write(entry, &sound[..end]).unwrap();
        assert_eq!(known(), 0, "cut at {end}");
    }
    for at in 0..sound.len() {
        let mut bytes = sound.clone();
        bytes[at] ^= 1 << (at % 8);
        fs::write(entry, bytes).unwrap();
        assert_eq!(known(), 0, "byte {at}");
    }
    fs::write(entry, [&sound[..], b"x"].concat()).unwrap();
    assert_eq!(known(), 0);
    // What is damaged is replaced.
    cache.save(&file, &bounds(&file)).unwrap();
    assert_eq!(known(), file.chunks.len());
    // Outside of the header's bounds nothing can lie.
    let mut wrong = bounds(&file);
    wrong[1].as_mut().unwrap().max[0] += 100_000;
    cache.forget(&file);
    cache.save(&file, &wrong).unwrap();
    let known = all_of(&cache.load(&file), &file);
    assert!(known[1].is_none() && known[0].is_some());
}

#[test]
fn the_folder_stays_small_and_need_not_be_there() {
    let folder = tempfile::tempdir().unwrap();
    let kept = folder.path().join("kept");
    let cache = Cache::at(kept.clone());
    // Chunks of 50 points: what is known of them would be large beside them.
    let path = folder.path().join("tiny.laz");
    fs::write(&path, Made::new(6, Packing::Fixed(50), 500).bytes()).unwrap();
    let tiny = LidarFile::open(&path).unwrap();
    cache.save(&tiny, &bounds(&tiny)).unwrap();
    assert!(!kept.exists());

    let files: Vec<_> = (0..3).map(|k| tile(folder.path(), &format!("{k}.laz"))).collect();
    for (k, file) in files.iter().enumerate() {
        cache.save(file, &bounds(file)).unwrap();
        let newest = entries(&kept).into_iter().max_by_key(|e| fs::metadata(e).unwrap().modified().unwrap());
        let time = SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000 + k as u64);
        fs::File::options().write(true).open(newest.unwrap()).unwrap().set_modified(time).unwrap();
    }
    let len = fs::metadata(&entries(&kept)[0]).unwrap().len();
    fs::write(kept.join("somebody else's.txt"), [0; 5000]).unwrap();
    cache.tidy().unwrap();
    assert_eq!(entries(&kept).len(), 4);
    cache.clone().with_room(2 * len + 100).tidy().unwrap();
    let known = |file| cache.load(file).is_whole(file);
    assert_eq!(files.iter().map(known).collect::<Vec<_>>(), [false, true, true], "the oldest goes");
    assert_eq!(entries(&kept).len(), 3);

    // A file in the folder's place.
    fs::write(folder.path().join("file"), "x").unwrap();
    let cache = Cache::at(folder.path().join("file/kept"));
    assert!(cache.save(&files[0], &bounds(&files[0])).is_err());
    assert!(all_of(&cache.load(&files[0]), &files[0]).iter().all(Option::is_none));
    assert!(cache.tidy().is_err());
}

fn beside(file: &LidarFile) -> PathBuf {
    file.path().with_extension("lax")
}

/// Each chunk's points lie in its bounds; gives the ground that those cover, in parts of the file's.
fn check(known: &Known, file: &LidarFile) -> f64 {
    let true_bounds = bounds(file);
    let area = |low: [i32; 3], high: [i32; 3]| {
        (f64::from(high[0]) - f64::from(low[0])) * (f64::from(high[1]) - f64::from(low[1]))
    };
    let mut whole = RawBounds::NOTHING;
    let mut covered = 0.0;
    for (chunk, points) in file.chunks.iter().zip(true_bounds) {
        let ((told, known), points) = (known.of(chunk).unwrap(), points.unwrap());
        assert_eq!(told, Told::Index);
        assert!(known.holds(points.min) && known.holds(points.max), "{known:?} {points:?}");
        covered += area(known.min, known.max);
        (0..3).for_each(|axis| whole.widen(axis, &[points.min[axis], points.max[axis]]));
    }
    covered / (file.chunks.len() as f64 * area(whole.min, whole.max))
}

#[test]
fn an_index_tells_where_chunks_lie() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.laz", "B.LAS"] {
        let file = tile(folder.path(), name);
        let points = crate::lax_writer::points(&file);
        assert!(all_of(&lax::look_up(&file).unwrap(), &file).iter().all(Option::is_none));
        let path = if name == "B.LAS" { file.path().with_extension("LAX") } else { beside(&file) };
        let usual = Lax::of(&points, 5, 0);
        let truth = bounds(&file).iter().flatten().fold(0.0, |sum, b| {
            sum + (f64::from(b.max[0]) - f64::from(b.min[0])) * (f64::from(b.max[1]) - f64::from(b.min[1]))
        });
        let mut least = f64::INFINITY;
        for index in [
            usual.clone(),
            Lax { wide: true, ..usual.clone() },
            Lax { tagged: false, ..usual.clone() },
            Lax::of(&points, 5, 500),
            Lax::of(&points, 0, 0),
        ] {
            fs::write(&path, index.bytes()).unwrap();
            let known = lax::look_up(&file).unwrap();
            assert!(known.is_whole(&file));
            let covered = check(&known, &file);
            least = least.min(covered);
            assert!(index.levels > 0 || covered > 0.99, "{covered}");
        }
        assert!(truth > 0.0 && least < 0.95, "the bounds of chunks are no smaller than the file: {least}");
    }
}

#[test]
fn an_index_within_the_file_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let file = tile(folder.path(), "a.laz");
    let index = Lax::of(&crate::lax_writer::points(&file), 4, 0).bytes();
    let sound = fs::read(file.path()).unwrap();
    let mut record = vec![0u8; 60];
    record[2..10].copy_from_slice(b"LAStools");
    record[18..20].copy_from_slice(&30u16.to_le_bytes());
    record[20..28].copy_from_slice(&(index.len() as u64).to_le_bytes());
    // As an extended record of the header's, and as one that only LASzip's record knows of.
    let laszip = file.vlr("laszip encoded", 22204).unwrap().offset as usize;
    let start = (sound.len() as u64).to_le_bytes();
    let by_header: &[(usize, &[u8])] = &[(235, &start), (243, &1u32.to_le_bytes())];
    let by_laszip: &[(usize, &[u8])] = &[(laszip + 16, &1i64.to_le_bytes()), (laszip + 24, &start)];
    for (k, fields) in [by_header, by_laszip].into_iter().enumerate() {
        let mut bytes = sound.clone();
        for (at, value) in fields {
            bytes[*at..at + value.len()].copy_from_slice(value);
        }
        bytes.extend(&record);
        bytes.extend(&index);
        let path = folder.path().join(format!("with {k}.laz"));
        fs::write(&path, &bytes).unwrap();
        let with = LidarFile::open(&path).unwrap();
        assert!(with.warnings.is_empty(), "{:?}", with.warnings);
        check(&lax::look_up(&with).unwrap(), &with);
        // Broken, it is named with its place in the file.
        let at = bytes.len() - index.len() + 8;
        bytes[at] = b'?';
        fs::write(&path, &bytes).unwrap();
        let error = lax::look_up(&LidarFile::open(&path).unwrap()).unwrap_err().to_string();
        assert!(
            error.contains(&format!("with {k}.laz: byte {at}: not used: \"?ASS\" instead of")),
            "{error}"
        );
    }
}

/// 500 points in ten chunks, with an index; its bytes.
fn small(folder: &Path) -> (LidarFile, Vec<u8>) {
    let path = folder.join("small.laz");
    fs::write(&path, Made::new(3, Packing::Fixed(50), 500).bytes()).unwrap();
    let file = LidarFile::open(&path).unwrap();
    let index = Lax::of(&crate::lax_writer::points(&file), 1, 3).bytes();
    (file, index)
}

#[test]
fn broken_indices_are_named_and_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let (file, sound) = small(folder.path());
    let path = beside(&file);
    let look_up = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        lax::look_up(&file)
    };
    check(&look_up(&sound).unwrap(), &file);
    for end in 0..sound.len() {
        let error = look_up(&sound[..end]).unwrap_err();
        assert!(matches!(error, LaxError::Bad { offset, .. } if offset <= end as u64), "{end}: {error}");
        assert!(error.to_string().contains("small.lax: byte "), "{error}");
    }
    // Fields that say what cannot be: where, and what.
    for (at, value, says) in [
        (4, 7u32, "the index's version is 7"),
        (12, 1, "the type of index is 1"),
        (24, 16, "the number of levels is 16"),
        (28, 1, "the level index is 1"),
        (36, f32::NAN.to_bits(), "is no box"),
        (40, (-1e9f32).to_bits(), "is no box"),
        (52 + 4, 2, "the version of its intervals is 2"),
        (52 + 12, 77, "there is no cell 77 in 1 levels"),
        (52 + 20, 1 << 30, "points in"),
        (52 + 24, 600, "records 600 to"),
        (52 + 28, 500, " to 500 of 500"),
    ] {
        let mut bytes = sound.clone();
        bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
        let error = look_up(&bytes).unwrap_err().to_string();
        assert!(error.contains(says), "{at}: {error}");
    }
    // Of another file: fewer points than there are.
    let points = crate::lax_writer::points(&file);
    let error = look_up(&Lax::of(&points[..400], 1, 0).bytes()).unwrap_err().to_string();
    assert!(error.contains("record 400 of 500 is in no cell"), "{error}");
    // Older than the file.
    fs::write(&path, &sound).unwrap();
    let before = file.bytes.modified().unwrap() - Duration::from_secs(1);
    fs::File::options().write(true).open(&path).unwrap().set_modified(before).unwrap();
    assert!(matches!(lax::look_up(&file), Err(LaxError::Older { .. })));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever it says, it is refused or gives bounds of chunks, in no time.
    #[test]
    fn random_damage_is_refused_or_harmless(flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
        thread_local! {
            static SMALL: (tempfile::TempDir, LidarFile, Vec<u8>) = {
                let folder = tempfile::tempdir().unwrap();
                let (file, index) = small(folder.path());
                (folder, file, index)
            };
        }
        SMALL.with(|(_, file, sound)| {
            let mut bytes = sound.clone();
            for (at, value) in &flips {
                let at = at.index(bytes.len());
                bytes[at] = *value;
            }
            fs::write(beside(file), &bytes).unwrap();
            match lax::look_up(file) {
                Ok(known) => prop_assert_eq!(all_of(&known, file).len(), file.chunks.len()),
                Err(LaxError::Bad { offset, .. }) => prop_assert!(offset <= bytes.len() as u64),
                Err(error) => prop_assert!(false, "{}", error),
            }
            Ok(())
        })?;
    }
}

/// Opening compares both with the points that it reads.
#[test]
fn opening_sees_what_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let file = tile(folder.path(), "tile.laz");
    let paths = [file.path().to_owned()];
    let cache = Cache::at(folder.path().join("kept"));
    let options = LoadOptions {
        surface: Surface::Columns,
        cell: Some(0.5.into()),
        placement: PlacementOptions::default(),
        rgb_bits: None,
        asked: lasray::sample::Asked::default(),
        budget: Budget { host_bytes: 1 << 30, device_bytes: 1 << 30 },
        cache: Some(cache.clone()),
        quiet: true,
    };
    let open = || {
        let mut problems = Problems::default();
        let mut opening = load::open(&paths, &options, &mut problems).unwrap();
        let input = opening.inputs.remove(0);
        let told = input.input.file.chunks.iter().map(|chunk| input.known.of(chunk).map(|(told, _)| told));
        assert!(!problems.failed);
        (told.collect::<Vec<_>>(), problems.lines())
    };
    let chunks = file.chunks.len();
    assert_eq!(open(), (vec![None; chunks], vec![]));

    // The second chunk without its first point.
    let mut first = 0;
    let sink = &mut |block: &PointBlock| first = block.x[0];
    Decoder::default().decode(&file, &file.chunks[1], 0..1, sink).unwrap();
    let mut lie = bounds(&file);
    let second = lie[1].as_mut().unwrap();
    if first > second.min[0] {
        second.max[0] = first - 1
    } else {
        second.min[0] = first + 1
    }
    cache.save(&file, &lie).unwrap();
    let (told, said) = open();
    assert_eq!(told, vec![None; chunks]);
    assert!(
        said.len() == 1 && said[0].contains("tile.laz: points lie outside of the bounds that were kept"),
        "{said:?}"
    );
    assert!(all_of(&cache.load(&file), &file).iter().all(Option::is_none), "it is forgotten");

    // An index, of which one chunk is known better.
    let points = crate::lax_writer::points(&file);
    fs::write(beside(&file), Lax::of(&points, 4, 0).bytes()).unwrap();
    let mut part = vec![None; chunks];
    part[2] = bounds(&file)[2];
    cache.save(&file, &part).unwrap();
    let (told, said) = open();
    let expected: Vec<_> =
        (0..chunks).map(|k| Some(if k == 2 { Told::Cache } else { Told::Index })).collect();
    assert_eq!((told, said), (expected, vec![]));

    // An index that has east and west the wrong way round.
    cache.forget(&file);
    let [west, east] = [0, 1].map(|k| {
        let of = |a: f64, p: &[f64; 2]| if k == 0 { a.min(p[0]) } else { a.max(p[0]) };
        points.iter().fold(points[0][0], of)
    });
    let mirrored: Vec<_> = points.iter().map(|p| [west + east - p[0], p[1]]).collect();
    fs::write(beside(&file), Lax::of(&mirrored, 6, 0).bytes()).unwrap();
    let (told, said) = open();
    assert_eq!(told, vec![None; chunks]);
    assert!(said.len() == 1 && said[0].contains("spatial index (.lax)"), "{said:?}");

    // One that is older, and one that is broken: said, and that is all.
    let older = file.bytes.modified().unwrap() - Duration::from_secs(9);
    fs::File::options().write(true).open(beside(&file)).unwrap().set_modified(older).unwrap();
    let (told, said) = open();
    assert_eq!(told, vec![None; chunks]);
    assert!(
        said.len() == 1 && said[0].starts_with("note: ") && said[0].contains("tile.lax: not used: older"),
        "{said:?}"
    );
    fs::write(beside(&file), "LASX").unwrap();
    let (told, said) = open();
    assert_eq!(told, vec![None; chunks]);
    assert!(
        said.len() == 1 && said[0].starts_with("warning: ") && said[0].contains("tile.lax: byte 4"),
        "{said:?}"
    );
}
