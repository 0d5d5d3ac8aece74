//! Files made in memory, in every format and packing: what comes out is what went in.

use crate::made::{
    FORMAT_LEN, Made, Packing, append, columns, compatible, data_dir, decode_all, more_columns,
};
use lasray::source::{Chunk, Decoder, Fields, LayerMemory, LidarFile, PointBlock, SourceError, Warning};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};

/// A directory that holds one file.
struct OnDisk {
    _dir: tempfile::TempDir,
    path: PathBuf,
}

fn on_disk(bytes: &[u8]) -> OnDisk {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("made.laz");
    std::fs::write(&path, bytes).unwrap();
    OnDisk { _dir: dir, path }
}

/// Opens `bytes`, decodes all, and expects the first `points` records of `made` (all chunks sound).
fn expect(made: &Made, bytes: &[u8], points: usize, warnings: &[Warning]) {
    let disk = on_disk(bytes);
    let file = LidarFile::open(&disk.path).unwrap();
    assert_eq!(file.warnings, warnings, "{made:?}");
    let (all, errors) = decode_all(&file);
    assert!(errors.is_empty(), "{errors:?}");
    let raw = &made.records[..points * made.record_len()];
    assert!(all == columns(made.format, made.record_len(), raw), "format {} {:?}", made.format, made.packing);
    assert_eq!(file.points(), points as u64);
}

/// Every way to write `format`.
fn packings(format: u8) -> Vec<Made> {
    let mut all = vec![
        Made::new(format, Packing::Plain, 700),
        Made::new(format, Packing::Plain, 120_000),
        Made::new(format, Packing::Plain, 300).with_extra(5),
        Made::new(format, Packing::Fixed(250), 1000),
        Made::new(format, Packing::Fixed(250), 1001),
        Made::new(format, Packing::Fixed(20_000), 45_000),
        Made::new(format, Packing::Variable(vec![10, 1, 500, 300]), 811),
        Made::new(format, Packing::Variable(vec![10, 1, 500, 300]), 811).with_extra(9),
        Made::new(format, Packing::Fixed(100), 0),
        Made::new(format, Packing::Plain, 0),
    ];
    if format < 6 {
        all.push(Made::new(format, Packing::PointWise, 900));
        all.push(Made::new(format, Packing::PointWise, 900).with_extra(3).with_items(1));
        all.push(Made::new(format, Packing::Fixed(250), 1000).with_items(1));
    } else {
        all.push(Made::new(format, Packing::Fixed(250), 1000).with_items(4));
        all.push(Made::new(format, Packing::Copc(vec![100, 50, 1, 400, 20]), 571));
    }
    all
}

#[test]
fn every_format_and_packing() {
    for format in 0..=10 {
        for made in packings(format) {
            expect(&made, &made.bytes(), made.points(), &[]);
        }
    }
}

/// Source ids, scan angles and times, where they are asked for, alone and together.
#[test]
fn fields_that_are_asked_for_are_those_that_were_written() {
    for format in 0..=10 {
        for made in packings(format) {
            let disk = on_disk(&made.bytes());
            let file = LidarFile::open(&disk.path).unwrap();
            let written = columns(made.format, made.record_len(), &made.records);
            let raw = more_columns(made.format, made.record_len(), &made.records);
            for bits in 0..8u8 {
                let [source_id, scan_angle, gps_time] = [1, 2, 4].map(|bit| bits & bit != 0);
                let mut decoder = Decoder::default();
                decoder.set_fields(Fields { source_id, scan_angle, gps_time });
                let (mut ids, mut angles) = (Vec::<u16>::new(), Vec::<i16>::new());
                let (mut times, mut x) = (Vec::<u64>::new(), Vec::<i32>::new());
                for chunk in &file.chunks {
                    let mut take = |block: &PointBlock| {
                        ids.extend(&block.source_id);
                        angles.extend(&block.scan_angle);
                        times.extend(block.gps_time.iter().map(|time| time.to_bits()));
                        x.extend(&block.x);
                    };
                    decoder.decode(&file, chunk, 0..chunk.records, &mut take).unwrap();
                }
                let what = format!("format {format} {:?} {bits:b}", made.packing);
                assert!(x == written.x, "{what}");
                assert!(ids == if source_id { raw.0.clone() } else { Vec::new() }, "{what}");
                assert!(angles == if scan_angle { raw.1.clone() } else { Vec::new() }, "{what}");
                assert!(times == if gps_time { raw.2.clone() } else { Vec::new() }, "{what}");
            }
            // The first points of chunks have them raw.
            let mut decoder = Decoder::default();
            decoder.set_fields(Fields::ALL);
            let firsts = decoder.first_points(&file, 65_536).unwrap();
            assert_eq!(firsts.source_id.first(), raw.0.first());
            assert_eq!(firsts.gps_time.first().map(|time| time.to_bits()), raw.2.first().copied());
        }
    }
}

/// Layers that are skipped change nothing in those that are not, and are not read.
#[test]
fn layers_that_are_skipped_are_not_missed() {
    for format in 6..=10 {
        let mut skipped = 0;
        for made in packings(format) {
            let disk = on_disk(&made.bytes());
            let file = LidarFile::open(&disk.path).unwrap();
            for chunk in &file.chunks {
                let [some, all] =
                    [Decoder::default(), Decoder::default().with_all_layers()].map(|mut decoder| {
                        let mut points = PointBlock::default();
                        decoder
                            .decode(&file, chunk, 0..chunk.records, &mut |block| append(&mut points, block))
                            .unwrap();
                        (points, decoder.bytes_read(&file, chunk).unwrap())
                    });
                assert!(some.0 == all.0, "format {format} {:?}", made.packing);
                assert_eq!(all.1, chunk.byte_len);
                skipped += all.1 - some.1;
            }
        }
        assert!(skipped > 0, "format {format}");
    }
}

/// The same with one record again and again from `first` on.
fn alike_from(first: usize, mut made: Made) -> Made {
    let len = made.record_len();
    let record = made.records[first * len..(first + 1) * len].to_vec();
    made.records[first * len..].chunks_mut(len).for_each(|other| other.copy_from_slice(&record));
    made
}

#[test]
fn a_range_of_a_chunk_is_that_range() {
    let packings = [
        Made::new(3, Packing::Plain, 60_000),
        Made::new(3, Packing::Fixed(30_000), 60_000),
        Made::new(7, Packing::Fixed(30_000), 60_000),
        Made::new(3, Packing::PointWise, 60_000),
        // All that differs is at the start: no share of the layers holds it.
        alike_from(31_000, Made::new(7, Packing::Fixed(30_000), 60_000)),
        alike_from(31_000, Made::new(6, Packing::Fixed(30_000), 60_000)),
    ];
    for made in packings {
        let disk = on_disk(&made.bytes());
        let file = LidarFile::open(&disk.path).unwrap();
        let mut decoder = Decoder::default();
        let chunk = file.chunks.last().unwrap();
        for range in
            [0..1, 0..900, 0..7_000, 0..20_000, 9_990..u64::MAX, 17_000..17_003, 5..5, u64::MAX - 1..u64::MAX]
        {
            let (mut all, mut first) = (PointBlock::default(), None);
            let sink = &mut |b: &PointBlock| {
                first.get_or_insert(b.first_record);
                append(&mut all, b);
            };
            decoder.decode(&file, chunk, range.clone(), sink).unwrap();
            let at = (chunk.first_record + range.start.min(chunk.records)) as usize;
            let end = (chunk.first_record + range.end.min(chunk.records)) as usize;
            let len = made.record_len();
            assert!(all == columns(made.format, len, &made.records[at * len..end * len]), "{range:?}");
            assert_eq!(first, (at < end).then_some(at as u64));
        }
    }
}

#[test]
fn first_points_are_the_chunks_first() {
    for made in [
        Made::new(3, Packing::Fixed(100), 950).with_extra(2),
        Made::new(7, Packing::Fixed(100), 950),
        Made::new(10, Packing::Variable(vec![100; 9]), 900),
        Made::new(8, Packing::Copc(vec![100; 9]), 900),
    ] {
        let disk = on_disk(&made.bytes());
        let file = LidarFile::open(&disk.path).unwrap();
        let mut decoder = Decoder::default();
        for (most, stride) in [(1000, 1), (4, 3), (1, 10), (0, 10)] {
            let len = made.record_len();
            let first: Vec<u8> = made.records.chunks(100 * len).flat_map(|c| &c[..len]).copied().collect();
            let picked: Vec<u8> = first.chunks(len).step_by(stride).flatten().copied().collect();
            let block = decoder.first_points(&file, most).unwrap();
            assert_eq!(*block, columns(made.format, len, &picked), "{most}");
        }
    }
    let empty = on_disk(&Made::new(3, Packing::Plain, 0).bytes());
    assert!(Decoder::default().first_points(&LidarFile::open(&empty.path).unwrap(), 10).unwrap().is_empty());
}

#[test]
fn copc_nodes_have_bounds_and_records_in_file_order() {
    let made = Made::new(7, Packing::Copc(vec![100, 50, 1, 400, 20]), 571);
    let disk = on_disk(&made.bytes());
    let file = LidarFile::open(&disk.path).unwrap();
    assert!(file.header.copc);
    let copc = file.copc.as_ref().unwrap();
    assert_eq!(copc.nodes.len(), file.chunks.len());
    let [min, max] = file.chunk_bounds(&file.chunks[0]).unwrap();
    assert_eq!((min.x, min.y, max.z), (500_000.0, 6_000_000.0, 50_500.0));
    let [min, max] = file.chunk_bounds(&file.chunks[2]).unwrap();
    assert_eq!((min.x, max.x), (525_000.0, 537_500.0));
    assert_eq!(file.chunks.iter().map(|c| c.first_record).collect::<Vec<_>>(), [0, 100, 150, 151, 551]);
    // The hierarchy is the second extended record.
    let record = file.vlrs.iter().find(|v| v.is("copc", 1000)).unwrap();
    assert!(record.extended && file.vlr("LASF_Projection", 2112).is_some_and(|v| !v.extended));
    assert!(matches!(record.read(&file.bytes, 10), Err(SourceError::Vlr { .. })));
    assert_eq!(record.read(&file.bytes, 1 << 20).unwrap().len() as u64, record.len);
}

#[test]
fn a_broken_hierarchy_falls_back_to_the_chunk_table() {
    let made = Made::new(7, Packing::Copc(vec![100, 50, 1, 400, 20]), 571);
    let good = made.bytes();
    let info = 375 + 54;
    let root = u64::from_le_bytes(good[info + 40..info + 48].try_into().unwrap()) as usize;
    let breaks: [(usize, &[u8], &str); 10] = [
        (info + 24, &f64::NAN.to_le_bytes(), "half size NaN"),
        (info + 40, &u64::MAX.to_le_bytes(), "does not fit"),
        (info + 48, &(1u64 << 40).to_le_bytes(), "does not fit"),
        (info + 48, &33u64.to_le_bytes(), "does not fit"),
        (root, &31i32.to_le_bytes(), "there is no node"),
        (root + 4, &1i32.to_le_bytes(), "there is no node"),
        (root + 28, &(-2i32).to_le_bytes(), "-2 points"),
        (root + 28, &99i32.to_le_bytes(), "it has 570 points"),
        (root + 24, &i32::MAX.to_le_bytes(), "2147483647 bytes"),
        (root + 32 + 16, &1000u64.to_le_bytes(), "overlaps"),
    ];
    for (at, bytes, reason) in breaks {
        let mut broken = good.clone();
        broken[at..at + bytes.len()].copy_from_slice(bytes);
        let disk = on_disk(&broken);
        let file = LidarFile::open(&disk.path).unwrap();
        assert!(file.copc.is_none() && !file.header.copc);
        let [warning] = file.warnings.as_slice() else { panic!("{:?}", file.warnings) };
        assert!(matches!(warning, Warning::CopcHierarchy { .. }), "{warning}");
        assert!(warning.to_string().contains(reason), "{warning}");
        let (all, errors) = decode_all(&file);
        assert!(errors.is_empty() && all == columns(7, 36, &made.records), "{reason}");
    }
}

#[test]
fn a_page_that_names_itself_ends() {
    let made = Made::new(7, Packing::Copc(vec![100, 50, 1, 400, 20]), 571);
    let mut bytes = made.bytes();
    let root = u64::from_le_bytes(bytes[375 + 54 + 40..375 + 54 + 48].try_into().unwrap());
    let link = root as usize + 4 * 32;
    assert_eq!(bytes[link + 28..link + 32], [255; 4]);
    bytes[link + 16..link + 24].copy_from_slice(&root.to_le_bytes());
    let disk = on_disk(&bytes);
    let file = LidarFile::open(&disk.path).unwrap();
    assert!(file.warnings[0].to_string().contains("is named twice"), "{:?}", file.warnings);
    assert_eq!(decode_all(&file).0.len(), 571);
}

/// The file without its chunk table and with a pointer of -1.
fn without_table(good: &[u8], points: usize) -> Vec<u8> {
    let table = u64::from_le_bytes(good[points..points + 8].try_into().unwrap()) as usize;
    let mut bytes = good[..table].to_vec();
    bytes[points..points + 8].copy_from_slice(&(-1i64).to_le_bytes());
    bytes
}

fn offset_to_points(bytes: &[u8]) -> usize {
    u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize
}

#[test]
fn a_pointer_at_the_end_of_the_file_is_found() {
    for format in [3, 7] {
        let made = Made::new(format, Packing::Fixed(250), 1001);
        let mut bytes = made.bytes();
        let points = offset_to_points(&bytes);
        let pointer = bytes[points..points + 8].to_vec();
        bytes[points..points + 8].copy_from_slice(&(-1i64).to_le_bytes());
        bytes.extend(pointer);
        expect(&made, &bytes, 1001, &[]);
    }
}

#[test]
fn without_a_table_points_are_found_from_the_data() {
    for format in [0, 3, 5, 6, 7, 10] {
        let made = Made::new(format, Packing::Fixed(250), 1001);
        let good = made.bytes();
        let bytes = without_table(&good, offset_to_points(&good));
        let disk = on_disk(&bytes);
        let file = LidarFile::open(&disk.path).unwrap();
        assert!(matches!(file.warnings.as_slice(), [Warning::ChunkTable { .. }]), "{:?}", file.warnings);
        let (all, errors) = decode_all(&file);
        assert!(errors.is_empty(), "{errors:?}");
        assert!(all == columns(format, made.record_len(), &made.records), "format {format}");
    }
    // Where each chunk has its own count, only layered ones say it themselves.
    for (format, points, warnings) in [(3, 0, 2), (7, 811, 1)] {
        let made = Made::new(format, Packing::Variable(vec![10, 1, 500, 300]), 811);
        let good = made.bytes();
        let disk = on_disk(&without_table(&good, offset_to_points(&good)));
        let file = LidarFile::open(&disk.path).unwrap();
        assert_eq!(file.warnings.len(), warnings, "{:?}", file.warnings);
        let (all, errors) = decode_all(&file);
        assert!(errors.is_empty() && all.len() == points, "{errors:?}");
    }
}

#[test]
fn a_table_that_breaks_off_is_used_as_far_as_it_goes() {
    for format in [3, 7] {
        let made = Made::new(format, Packing::Fixed(50), 1001);
        let good = made.bytes();
        // Cut within the entries: the pointer stays good.
        let bytes = &good[..good.len() - 6];
        let disk = on_disk(bytes);
        let file = LidarFile::open(&disk.path).unwrap();
        assert!(matches!(file.warnings.as_slice(), [Warning::ChunkTable { .. }]), "{:?}", file.warnings);
        let (all, errors) = decode_all(&file);
        assert!(errors.is_empty(), "{errors:?}");
        assert!(all == columns(format, made.record_len(), &made.records), "format {format}");
    }
}

#[test]
fn a_table_of_four_billion_chunks_is_refused() {
    for format in [3, 7] {
        let made = Made::new(format, Packing::Fixed(250), 1001);
        let mut bytes = made.bytes();
        let points = offset_to_points(&bytes);
        let table = u64::from_le_bytes(bytes[points..points + 8].try_into().unwrap()) as usize;
        bytes[table + 4..table + 8].copy_from_slice(&u32::MAX.to_le_bytes());
        let disk = on_disk(&bytes);
        let file = LidarFile::open(&disk.path).unwrap();
        assert!(
            file.warnings[0].to_string().contains("4294967295 chunks are claimed"),
            "{:?}",
            file.warnings
        );
        assert_eq!(decode_all(&file).0.len(), 1001);
    }
}

#[test]
fn counts_that_lie() {
    let set = |made: &Made, count: u64| {
        let mut bytes = made.bytes();
        if made.minor < 4 {
            bytes[107..111].copy_from_slice(&(count as u32).to_le_bytes());
        } else {
            bytes[247..255].copy_from_slice(&count.to_le_bytes());
        }
        bytes
    };
    let las = Made::new(3, Packing::Plain, 1000);
    expect(&las, &set(&las, 1200), 1000, &[Warning::PointsMissing { claimed: 1200, readable: 1000 }]);
    let stopped = Warning::PointsUnclaimed { claimed: 0, found: 1000, read: 1000 };
    expect(&las, &set(&las, 0), 1000, &[stopped]);
    let las = Made::new(7, Packing::Plain, 1000);
    let most = u64::MAX;
    expect(&las, &set(&las, most), 1000, &[Warning::PointsMissing { claimed: most, readable: 1000 }]);

    // Layered chunks know their own counts.
    let layered = Made::new(7, Packing::Fixed(300), 1000);
    let missing = Warning::PointsMissing { claimed: 5000, readable: 1000 };
    expect(&layered, &set(&layered, 5000), 1000, &[missing]);
    for claimed in [0, 1, 850] {
        let unclaimed = Warning::PointsUnclaimed { claimed, found: 1000, read: 1000 };
        expect(&layered, &set(&layered, claimed), 1000, &[unclaimed]);
    }
    let variable = Made::new(3, Packing::Variable(vec![300; 3]), 900);
    let unclaimed = Warning::PointsUnclaimed { claimed: 7, found: 900, read: 900 };
    expect(&variable, &set(&variable, 7), 900, &[unclaimed]);

    // The others end with their bytes: a point or two of the last chunk cannot be told from padding.
    let fixed = Made::new(3, Packing::Fixed(300), 1000);
    for claimed in [0, 850, 5000] {
        let disk = on_disk(&set(&fixed, claimed));
        let file = LidarFile::open(&disk.path).unwrap();
        assert_eq!(file.warnings.len(), 1, "{:?}", file.warnings);
        let (all, errors) = decode_all(&file);
        assert!(errors.is_empty(), "{errors:?}");
        assert!((998..=1000).contains(&all.len()), "{}", all.len());
        assert!(all == columns(3, 34, &fixed.records[..34 * all.len()]));
    }
}

/// Counts that differ in a LAS 1.4 header: what the standard says of the format, but a file that is as long as one of
/// them.
#[test]
fn two_counts_that_differ() {
    let with_counts = |format: u8, packing: Packing, legacy: u32, large: u64| {
        let made = Made { minor: 4, ..Made::new(format, packing, 1000) };
        let mut bytes = made.bytes();
        bytes[107..111].copy_from_slice(&legacy.to_le_bytes());
        bytes[247..255].copy_from_slice(&large.to_le_bytes());
        (made, bytes)
    };
    for packing in [Packing::Plain, Packing::Fixed(300)] {
        for format in [6, 7, 10] {
            let (made, bytes) = with_counts(format, packing.clone(), 100, 1000);
            let why = "point formats 6 to 10 have no 32-bit count";
            let differ = Warning::CountsDiffer { legacy: 100, large: 1000, used: 1000, why };
            expect(&made, &bytes, 1000, &[differ]);
            let (made, bytes) = with_counts(format, packing.clone(), 1000, 0);
            let why = "the other one is 0";
            expect(&made, &bytes, 1000, &[Warning::CountsDiffer { legacy: 1000, large: 0, used: 1000, why }]);
        }
    }
    let (las, bytes) = with_counts(1, Packing::Plain, 100, 1000);
    let why = "the file is as long as that";
    expect(&las, &bytes, 1000, &[Warning::CountsDiffer { legacy: 100, large: 1000, used: 1000, why }]);
    for large in [100, 5000] {
        let (las, bytes) = with_counts(1, Packing::Plain, 1000, large);
        let why = "it is the one that readers of all versions go by";
        expect(&las, &bytes, 1000, &[Warning::CountsDiffer { legacy: 1000, large, used: 1000, why }]);
    }
}

#[test]
fn laszips_compatibility_mode_is_undone() {
    for format in 6..=10 {
        let packings =
            [Packing::Plain, Packing::Fixed(300), Packing::Variable(vec![400, 1, 599]), Packing::PointWise];
        for (packing, extra) in packings.into_iter().zip([0, 0, 3, 2]) {
            let (made, meant) = compatible(format, extra, packing, 1000);
            let disk = on_disk(&made.bytes());
            let file = LidarFile::open(&disk.path).unwrap();
            assert_eq!(file.warnings, [], "{made:?}");
            assert_eq!((file.header.format, file.header.stored_format), (format, made.format));
            assert_eq!(file.points(), 1000);
            let (all, errors) = decode_all(&file);
            assert!(errors.is_empty(), "{errors:?}");
            let len = FORMAT_LEN[usize::from(format)].into();
            let want = columns(format, len, &meant);
            assert!(want.class.iter().any(|&class| class > 31) && want.flags.iter().any(|f| f & 8 != 0));
            assert!(all == want, "{made:?}");
            // What is stored raw, too.
            let firsts = Decoder::default().first_points(&file, 1).unwrap().clone();
            assert_eq!((firsts.class[0], firsts.returns[0]), (want.class[0], want.returns[0]));
        }
    }
}

#[test]
fn a_compatibility_mode_that_cannot_be_is_said_to_be() {
    let good = || compatible(6, 0, Packing::Fixed(300), 1000).0;
    let warnings = |made: &Made| {
        let disk = on_disk(&made.bytes());
        let file = LidarFile::open(&disk.path).unwrap();
        let all = decode_all(&file).0.len() as u64;
        assert_eq!(all, file.points());
        let said: Vec<_> = file.warnings.iter().map(ToString::to_string).collect();
        (file.header.format, all, said.join("; "))
    };
    let mut made = good();
    made.vlrs[0].2.truncate(3 * 192);
    let (format, points, said) = warnings(&made);
    assert_eq!((format, points), (1, 1000));
    assert!(said.contains("names no \"LAS 1.4 flags and channel\": points are read as format 1"), "{said}");
    let mut made = good();
    made.vlrs[1].2.truncate(20);
    assert!(warnings(&made).2.contains("20 bytes, at least 156 are needed"));
    let mut made = good();
    // A first entry of which the record has no room.
    made.vlrs[0].2.splice(0..0, crate::made::extra_entry(10, 0, "wide"));
    assert!(warnings(&made).2.contains("of a record of 33: points are read as format 1"));
    // Cut out of a larger file by a program that carries records along.
    let mut made = good();
    made.vlrs[1].2[28..36].copy_from_slice(&5000u64.to_le_bytes());
    let (format, points, said) = warnings(&made);
    assert_eq!((format, points), (6, 1000));
    assert!(said.contains("it counts 5000 points, the header 1000; 1000 is used"), "{said}");
    // A writer that left the part of LAS 1.4 out, and one that left the count of the header out.
    let mut made = good();
    made.vlrs[1].2.fill(0);
    assert_eq!(warnings(&made), (6, 1000, String::new()));
    let made = good();
    let mut bytes = made.bytes();
    bytes[107..111].fill(0);
    let disk = on_disk(&bytes);
    let file = LidarFile::open(&disk.path).unwrap();
    assert_eq!((file.points(), file.warnings.len()), (1000, 0), "{:?}", file.warnings);
}

/// The files that were made after what people reported of other readers.
#[test]
fn reported_files_are_read_as_they_are_meant() {
    let Some(folder) = data_dir().map(|data| data.join("reports")).filter(|folder| folder.is_dir()) else {
        println!("skipped: no files after reports");
        return;
    };
    let read = |name: &str| {
        let file = LidarFile::open(&folder.join(name)).unwrap();
        let (all, errors) = decode_all(&file);
        assert!(errors.is_empty(), "{errors:?}");
        (file, all)
    };
    let (_, all) = read("legacy_count_format6.las");
    assert_eq!(all.len(), 6000);
    let (file, all) = read("compat_mode.laz");
    assert_eq!((file.header.format, file.header.stored_format, all.len()), (6, 1, 6400));
    let of = |class: u8| all.class.iter().filter(|&&c| c == class).count();
    assert_eq!([of(0), of(40), of(45), of(64)], [0, 5876, 204, 320]);
}

#[test]
fn a_file_cut_anywhere_gives_its_beginning() {
    let packings = [
        Packing::Plain,
        Packing::Fixed(200),
        Packing::PointWise,
        Packing::Variable(vec![200; 5]),
        Packing::Copc(vec![200; 5]),
    ];
    for (format, packing) in [3, 7].into_iter().flat_map(|f| packings.clone().map(|p| (f, p))) {
        let bad = matches!((format, &packing), (3, Packing::Copc(_)) | (7, Packing::PointWise));
        if bad {
            continue;
        }
        let made = Made::new(format, packing, 1000);
        let good = made.bytes();
        for cut in (0..good.len()).step_by(97) {
            let disk = on_disk(&good[..cut]);
            let file = match LidarFile::open(&disk.path) {
                Ok(file) => file,
                Err(error) => {
                    assert!(cut <= offset_to_points(&good), "{error}");
                    continue;
                }
            };
            let (all, errors) = decode_all(&file);
            let told = !file.warnings.is_empty() || !errors.is_empty();
            assert!(told || all.len() == 1000, "{:?} cut at {cut}", made.packing);
            let raw = &made.records[..all.len() * made.record_len()];
            assert!(
                all == columns(format, made.record_len(), raw),
                "{:?} cut at {cut}: {errors:?}",
                made.packing
            );
        }
    }
}

#[test]
fn a_layered_chunk_beyond_the_limit_is_refused() {
    let made = Made::new(7, Packing::Fixed(1000), 1000);
    let disk = on_disk(&made.bytes());
    let file = LidarFile::open(&disk.path).unwrap();
    let error = Decoder::new(1000).decode(&file, &file.chunks[0], 0..1, &mut |_| ()).unwrap_err();
    assert!(error.to_string().contains("bytes of memory, 1000 are allowed"), "{error}");
}

/// Decoders that share memory wait for each other; what needs more than there is in all is refused.
#[test]
fn decoders_share_memory_for_layers() {
    let made = Made::new(7, Packing::Fixed(20_000), 80_000);
    let disk = on_disk(&made.bytes());
    let file = LidarFile::open(&disk.path).unwrap();
    let need = |chunk: &Chunk| Decoder::default().bytes_read(&file, chunk).unwrap();
    let most = file.chunks.iter().map(need).max().unwrap();
    let layers = LayerMemory::new(most + most / 2);
    let seen = AtomicU64::new(0);
    std::thread::scope(|scope| {
        for thread in 0..4 {
            let (file, layers, seen) = (&file, &layers, &seen);
            scope.spawn(move || {
                let (mut decoder, mut points) = (Decoder::sharing(layers), 0);
                for chunk in file.chunks.iter().cycle().skip(thread).take(4) {
                    let sink = &mut |block: &PointBlock| {
                        points += block.len();
                        seen.fetch_max(layers.held(), Ordering::Relaxed);
                    };
                    decoder.decode(file, chunk, 0..chunk.records, sink).unwrap();
                }
                assert_eq!(points, 80_000);
            });
        }
    });
    let seen = seen.into_inner();
    assert!(seen > most / 2 && seen <= most + most / 2, "{seen} of {most}");
    assert_eq!(layers.held(), 0);
    let mut decoder = Decoder::sharing(&LayerMemory::new(most / 2));
    let error = decoder.decode(&file, &file.chunks[0], 0..20_000, &mut |_| ()).unwrap_err();
    assert!(error.to_string().contains("chunk 0 at byte"), "{error}");
}

#[test]
fn layers_that_do_not_fit_their_chunk_are_named() {
    let made = Made::new(7, Packing::Fixed(500), 1000);
    let good = made.bytes();
    let disk = on_disk(&good);
    let chunk = LidarFile::open(&disk.path).unwrap().chunks[1];
    let mut bytes = good.clone();
    let sizes = chunk.byte_offset as usize + 36 + 4;
    bytes[sizes..sizes + 4].copy_from_slice(&u32::MAX.to_le_bytes());
    let disk = on_disk(&bytes);
    let file = LidarFile::open(&disk.path).unwrap();
    let (all, errors) = decode_all(&file);
    let [error] = errors.as_slice() else { panic!("{errors:?}") };
    let place = format!("chunk 1 at byte {}: its layers need 42949", chunk.byte_offset);
    assert!(error.to_string().contains(&place), "{error}");
    assert!(all == columns(7, 36, &made.records[..500 * 36]));
    // A count in the chunk that is too small.
    let mut bytes = good;
    bytes[sizes - 4..sizes].copy_from_slice(&450u32.to_le_bytes());
    let disk = on_disk(&bytes);
    let (all, errors) = decode_all(&LidarFile::open(&disk.path).unwrap());
    assert!(
        errors[0].to_string().contains("it says that it has 450 points (450 of 500 points read)"),
        "{errors:?}"
    );
    assert!(all == columns(7, 36, &made.records[..950 * 36]));
}

#[test]
fn a_file_that_vanishes_is_named() {
    let made = Made::new(3, Packing::Fixed(500), 1000);
    let disk = on_disk(&made.bytes());
    let file = LidarFile::open(&disk.path).unwrap();
    file.bytes.release();
    assert_eq!(decode_all(&file).0.len(), 1000);
    file.bytes.release();
    std::fs::remove_file(&disk.path).unwrap();
    let (all, errors) = decode_all(&file);
    assert!(all.is_empty() && errors.len() == 2);
    assert!(errors[0].to_string().contains("made.laz: cannot reopen"), "{}", errors[0]);
}

/// The `las` crate's writer and reader on one side, ours on the other.
#[test]
fn the_las_writer_is_understood() {
    for format in (0..=10u8).filter(|f| ![4, 5, 9, 10].contains(f)) {
        for compressed in [false, true] {
            let mut builder = las::Builder::from((1, 4));
            builder.point_format = las::point::Format::new(format).unwrap();
            builder.point_format.is_compressed = compressed;
            let header = builder.into_header().unwrap();
            let dir = tempfile::tempdir().unwrap();
            let path = dir.path().join(if compressed { "w.laz" } else { "w.las" });
            let len = usize::from(FORMAT_LEN[usize::from(format)]);
            let raw = crate::made::records(format, 0, 60_000);
            let points =
                las::PointDataBuilder::new().for_header(&header).build_from_bytes(raw.clone()).unwrap();
            let mut writer = las::Writer::from_path(&path, header).unwrap();
            writer.write_points(&points).unwrap();
            writer.close().unwrap();
            let file = LidarFile::open(&path).unwrap();
            assert_eq!((file.header.compressed, file.warnings.as_slice()), (compressed, [].as_slice()));
            let (all, errors) = decode_all(&file);
            assert!(errors.is_empty(), "{errors:?}");
            assert!(all == columns(format, len, &raw), "format {format}");
            let read = las::Reader::from_path(&path).unwrap().read_all().unwrap();
            assert!(read.x_raw().eq(all.x.iter().copied()));
        }
    }
}

#[test]
fn workers_share_a_file() {
    let made = Made::new(3, Packing::Fixed(1000), 20_000);
    let disk = on_disk(&made.bytes());
    let file = LidarFile::open(&disk.path).unwrap();
    let sums: Vec<i64> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..4)
            .map(|worker| {
                let file = &file;
                scope.spawn(move || {
                    let (mut decoder, mut sum) = (Decoder::default(), 0);
                    for chunk in file.chunks.iter().skip(worker).step_by(4) {
                        let sink =
                            &mut |b: &PointBlock| sum += b.x.iter().map(|&x| i64::from(x)).sum::<i64>();
                        decoder.decode(file, chunk, 0..u64::MAX, sink).unwrap();
                        file.bytes.release();
                    }
                    sum
                })
            })
            .collect();
        workers.into_iter().map(|w| w.join().unwrap()).collect()
    });
    let wanted: i64 = columns(3, 34, &made.records).x.iter().map(|&x| i64::from(x)).sum();
    assert_eq!(sums.iter().sum::<i64>(), wanted);
}
