use super::*;
use crate::source::FLAG_OVERLAP;
use std::collections::{BTreeMap, HashMap};
use std::convert::Infallible;
use std::sync::atomic::AtomicBool;

/// One point of a scan, metres from the square.
#[derive(Clone, Copy, Debug)]
struct Point {
    x: f64,
    y: f64,
    z: f64,
    class: u8,
    flags: u8,
    returns: u8,
    source: u16,
    time: f64,
}

fn points(town: &Town, tile: Tile) -> Vec<Point> {
    let mut all = Vec::new();
    let done: Result<(), Infallible> = scan(town, &tile, |block| {
        let p = &block.points;
        assert_eq!(p.first_record, all.len() as u64);
        all.extend((0..block.len()).map(|k| Point {
            x: f64::from(p.x[k]) * SCALE,
            y: f64::from(p.y[k]) * SCALE,
            z: f64::from(p.z[k]) * SCALE,
            class: p.class[k],
            flags: p.flags[k],
            returns: p.returns[k],
            source: block.source_id[k],
            time: block.gps_time[k],
        }));
        Ok(())
    });
    done.unwrap();
    all
}

fn tile(corner: [f64; 2], side: f64, points: u64) -> Tile {
    Tile { corner, size: [side; 2], points }
}

/// Patches on demand.
struct Truth<'a>(&'a Town, HashMap<[i64; 2], Patch<'a>>);

impl<'a> Truth<'a> {
    fn at(&mut self, p: &Point) -> &Patch<'a> {
        let [i, j] = Patch::index(p.x, p.y);
        self.1.entry([i, j]).or_insert_with(|| Patch::new(self.0, i, j))
    }
}

#[test]
fn points_lie_on_the_town() {
    let town = Town::new(1);
    let mut truth = Truth(&town, HashMap::new());
    let mut seen = BTreeMap::new();
    for p in points(&town, tile([-150.0, -220.0], 320.0, 120_000)) {
        let patch = truth.at(&p);
        let (ground, roof) = (patch.ground(p.x, p.y), patch.roof(p.x, p.y));
        match p.class {
            // On the roof, so never on a wall: between eaves and ground there is nothing.
            class::BUILDING => assert!((p.z - roof.unwrap()).abs() < 0.08, "{p:?}: roof at {roof:?}"),
            class::GROUND | class::ROAD => {
                assert!((p.z - ground).abs() < 0.25, "{p:?}: ground at {ground}");
                assert!(
                    roof.is_none_or(|roof| roof <= ground),
                    "{p:?}: ground seen through a roof at {roof:?}"
                );
            }
            class::WATER => assert!((p.z - ground).abs() < 0.06, "{p:?}: water at {ground}"),
            class::BRIDGE => {
                // Ends on its ramps; the river runs 5 m below.
                assert!((4.9..6.2).contains(&(p.z - terrain::WATER_LEVEL)), "{p:?}");
                assert!(p.z > ground - 0.1, "{p:?}: ground at {ground}");
            }
            class::LOW_VEGETATION => assert!(p.z - ground < 2.4, "{p:?}: ground at {ground}"),
            class::HIGH_VEGETATION => assert!(p.z - ground > 4.6, "{p:?}: ground at {ground}"),
            class::LOW_NOISE => assert!(p.z < ground - 2.0),
            class::HIGH_NOISE => assert!(p.z > ground + 50.0),
            _ => {}
        }
        *seen.entry(p.class).or_insert(0) += 1;
    }
    for (class, least) in [
        (class::UNCLASSIFIED, 100),
        (class::GROUND, 30_000),
        (class::LOW_VEGETATION, 300),
        (class::MEDIUM_VEGETATION, 1_000),
        (class::HIGH_VEGETATION, 2_000),
        (class::BUILDING, 10_000),
        (class::WATER, 3_000),
        (class::ROAD, 8_000),
        (class::BRIDGE, 300),
    ] {
        assert!(seen.get(&class).is_some_and(|&n| n >= least), "class {class}: {seen:?}");
    }
}

#[test]
fn wires_hang_between_pylons() {
    let town = Town::new(1);
    let mut truth = Truth(&town, HashMap::new());
    let mut wires = Vec::new();
    let mut steel = 0;
    for p in points(&town, tile([-320.0, 60.0], 260.0, 200_000)) {
        let patch = truth.at(&p);
        let above = p.z - patch.ground(p.x, p.y);
        match p.class {
            class::WIRE => {
                assert!((p.z - patch.wire(p.x, p.y).unwrap()).abs() < 0.08, "{p:?}");
                assert!(above > 6.0, "{p:?} hangs {above} m above the ground");
                wires.push(above);
            }
            class::TOWER => {
                assert!(above < 38.0, "{p:?}");
                steel += 1;
            }
            _ => {}
        }
    }
    assert!(wires.len() > 500 && steel > 30, "{} wire points, {steel} tower points", wires.len());
    let reach = |pick: fn(f64, f64) -> f64| wires.iter().copied().reduce(pick).unwrap();
    assert!(reach(f64::max) - reach(f64::min) > 8.0, "wires at several heights, sagging");
}

#[test]
fn neighbouring_patches_agree_on_their_border() {
    let town = Town::new(3);
    for (i, j) in [(0, 0), (-3, 2), (40, -70)] {
        let [patch, east, north] = [(i, j), (i + 1, j), (i, j + 1)].map(|(i, j)| Patch::new(&town, i, j));
        for k in 1..640 {
            let t = f64::from(k) * 0.1;
            let (x, y) = (i as f64 * PATCH, j as f64 * PATCH);
            for (other, x, y) in [(&east, x + PATCH, y + t), (&north, x + t, y + PATCH)] {
                let (a, b) = (patch.section(x, y), other.section(x, y));
                assert!((a.ground - b.ground).abs() < 1e-9, "({x}, {y}): {} and {}", a.ground, b.ground);
                assert!((a.solid.height - b.solid.height).abs() < 1e-9, "({x}, {y}): {a:?} and {b:?}");
                assert_eq!(a.solid.class, b.solid.class);
                assert_eq!(a.leaves.map(|l| l.top), b.leaves.map(|l| l.top), "({x}, {y})");
                assert_eq!(a.wire.map(|w| w.class), b.wire.map(|w| w.class), "({x}, {y})");
            }
        }
    }
}

#[test]
fn counts_are_exact_and_points_stay_in_their_tile() {
    let town = Town::new(2);
    for (corner, side, n) in [
        ([-10.0, -10.0], 20.0, 1),
        ([0.0, 0.0], 1.0, 7),
        ([-250.0, -180.0], 90.0, 1_000),
        ([-220.0, -200.0], 440.0, 30_000),
        ([152_345.0, -98_765.0], 60.0, 5_000),
        ([-40.0, -175.0], 30.0, 70_000),
    ] {
        let tile = tile(corner, side, n);
        let got = points(&town, tile);
        assert_eq!(got.len() as u64, n);
        assert!(got.iter().all(|p| tile.contains(p.x, p.y)), "{tile:?}");
    }
}

#[test]
fn every_pulse_is_complete_and_sorted() {
    let town = Town::new(1);
    let all = points(&town, tile([60.0, 60.0], 200.0, 60_000));
    let mut several = 0;
    let mut rest = &all[..];
    while let Some(first) = rest.first() {
        let count = usize::from(first.returns >> 4);
        assert!((1..=5).contains(&count));
        let (pulse, next) = rest.split_at(count);
        for (k, p) in pulse.iter().enumerate() {
            assert_eq!(usize::from(p.returns & 15), k + 1);
            assert_eq!((usize::from(p.returns >> 4), p.time), (count, first.time));
            assert!(k == 0 || p.z < pulse[k - 1].z + 0.5, "{pulse:?}");
        }
        several += usize::from(count > 1);
        rest = next;
    }
    assert!(several > 3_000, "{several} pulses with several returns in a tile with forest");
    let ground_below = all.iter().filter(|p| p.class == class::GROUND && p.returns & 15 > 1).count();
    assert!(ground_below > 500, "{ground_below} ground points under trees");
}

#[test]
fn two_flight_lines_overlap() {
    let town = Town::new(1);
    let mut overlap = [0, 0];
    let mut last = HashMap::new();
    for p in points(&town, tile([-120.0, -60.0], 240.0, 40_000)) {
        let in_both = p.x.abs() < 50.0;
        assert_eq!(p.flags & FLAG_OVERLAP != 0, in_both, "{p:?}");
        match p.source {
            1 => assert!(p.x < 50.0),
            2 => assert!(p.x > -50.0),
            other => panic!("flight line {other}"),
        }
        if in_both {
            overlap[usize::from(p.source) - 1] += 1;
        }
        let before = last.insert(p.source, p.time).unwrap_or(f64::MIN);
        // Pulses of one line start a hair apart in time, jittered by where they really went.
        assert!(p.time > before - 0.02, "time runs on");
    }
    assert!(overlap[0] > 4_000 && overlap[1] > 4_000, "{overlap:?}");
}

#[test]
fn the_same_seed_gives_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let tile = tile([-30.0, -30.0], 60.0, 6_000);
    let write = |seed: u64, name: &str| {
        let path = folder.path().join(name);
        write_tile(&Town::new(seed), &tile, &path, Format::Seven, true, &AtomicBool::new(false), |_| ())
            .unwrap();
        std::fs::read(path).unwrap()
    };
    assert_eq!(write(5, "a.laz"), write(5, "b.laz"));
    assert_ne!(write(5, "a.laz"), write(6, "c.laz"));
}

#[test]
fn files_read_back_as_they_were_scanned() {
    let folder = tempfile::tempdir().unwrap();
    let town = Town::new(4);
    // More than one LAZ chunk.
    let tile = tile([-70.0, 10.0], 120.0, 60_000);
    for (format, compress, name) in [
        (Format::Three, false, "3.las"),
        (Format::Three, true, "3.laz"),
        (Format::Seven, false, "7.las"),
        (Format::Seven, true, "größe 7.laz"),
    ] {
        let path = folder.path().join(name);
        let mut told = 0;
        write_tile(&town, &tile, &path, format, compress, &AtomicBool::new(false), |n| told += n).unwrap();
        assert_eq!(told, tile.points);
        let mut reader = las::Reader::from_path(&path).unwrap();
        let header = reader.header().clone();
        assert_eq!(header.number_of_points(), tile.points);
        assert_eq!(header.version().minor, if format == Format::Three { 2 } else { 4 });
        assert_eq!(header.has_wkt_crs(), format == Format::Seven);
        assert!(header.has_crs_vlrs());
        if format == Format::Three {
            assert_eq!(
                header.get_geotiff_crs().unwrap().unwrap().get_projected_crs_geo_key_value(),
                Some(25832)
            );
        }
        let read: Vec<las::Point> = reader.read_all().unwrap().points().collect::<Result<_, _>>().unwrap();
        let mut by_return = [0; 6];
        let mut at = 0;
        let compared: Result<(), Infallible> = scan(&town, &tile, |block| {
            let p = &block.points;
            for k in 0..block.len() {
                let q = &read[at];
                at += 1;
                let world = [p.x[k], p.y[k], p.z[k]].map(|v| f64::from(v) * SCALE);
                let close = |a: f64, b: f64| (a - b).abs() < 1e-6;
                assert!(
                    close(q.x, world[0] + ORIGIN[0])
                        && close(q.y, world[1] + ORIGIN[1])
                        && close(q.z, world[2])
                );
                assert_eq!(u8::from(q.classification), p.class[k]);
                assert_eq!(q.intensity, p.intensity[k]);
                assert_eq!((q.return_number, q.number_of_returns), (p.returns[k] & 15, p.returns[k] >> 4));
                assert_eq!(q.gps_time, Some(block.gps_time[k]));
                assert_eq!(q.point_source_id, block.source_id[k]);
                assert_eq!(q.is_edge_of_flight_line, block.edge_of_line[k]);
                let color = q.color.unwrap();
                assert_eq!([color.red, color.green, color.blue], p.rgb[k]);
                if format == Format::Seven {
                    assert_eq!(q.is_overlap, p.flags[k] & FLAG_OVERLAP != 0);
                    assert!((q.scan_angle - block.scan_angle[k]).abs() < 0.006);
                } else {
                    assert!((q.scan_angle - block.scan_angle[k]).abs() <= 0.5);
                }
                by_return[usize::from(q.return_number)] += 1;
                let bounds = header.bounds();
                assert!(bounds.min.x <= q.x + 1e-6 && bounds.max.x >= q.x - 1e-6);
                assert!(bounds.min.z <= q.z + 1e-6 && bounds.max.z >= q.z - 1e-6);
            }
            Ok(())
        });
        compared.unwrap();
        assert_eq!(at, read.len());
        for number in 1..=5u8 {
            let counted = header.number_of_points_by_return(number).unwrap_or(0);
            assert_eq!(counted, by_return[usize::from(number)]);
        }
    }
}

#[test]
fn nothing_half_written_remains() {
    let folder = tempfile::tempdir().unwrap();
    let town = Town::new(1);
    let tile = tile([0.0, 0.0], 50.0, 100_000);
    let path = folder.path().join("old.laz");
    std::fs::write(&path, "an older file").unwrap();
    let stop = AtomicBool::new(false);
    let stopped = write_tile(&town, &tile, &path, Format::Seven, true, &stop, |_| {
        stop.store(true, std::sync::atomic::Ordering::Relaxed);
    });
    assert!(matches!(stopped, Err(SynthError::Stopped { .. })), "{stopped:?}");
    assert_eq!(std::fs::read(&path).unwrap(), b"an older file");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);

    let nowhere = folder.path().join("no/such/folder.las");
    let failed = write_tile(&town, &tile, &nowhere, Format::Three, false, &AtomicBool::new(false), |_| ());
    let message = failed.unwrap_err().to_string();
    assert!(message.contains("folder.las") && message.contains("cannot create"), "{message}");

    let many = Tile { points: 5_000_000_000, ..tile };
    let refused = write_tile(&town, &many, &path, Format::Three, false, &AtomicBool::new(false), |_| ());
    assert!(matches!(refused, Err(SynthError::TooManyPoints { .. })), "{refused:?}");
}

#[test]
fn the_demo_covers_its_half_metre_cells() {
    let (town, tiles) = demo();
    assert_eq!(tiles.iter().map(|t| t.points).sum::<u64>(), DEMO_POINTS);
    let tile = tiles[0];
    let side = (tile.size[0] * 2.0) as usize;
    let mut hit = vec![false; side * side];
    for p in points(&town, tile) {
        let cell = |value: f64, axis: usize| ((value - tile.corner[axis]) * 2.0) as usize;
        hit[cell(p.y, 1) * side + cell(p.x, 0)] = true;
    }
    let share = hit.iter().filter(|&&h| h).count() as f64 / hit.len() as f64;
    assert!(share > 0.97, "{share} of the cells are hit");
}
