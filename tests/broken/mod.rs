//! Sound files, and what can be done to them at random.

#![allow(dead_code)] // each test binary uses its part

use crate::made::{Made, Packing, data_dir, las_crate_files, lidar_files};
use lasray::source::LidarFile;
use proptest::{
    prelude::*,
    sample::Index,
    test_runner::{Config, RngSeed, TestCaseError, TestError, TestRunner},
};
use std::{
    fs,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    time::{Duration, Instant},
};

/// Longer than any case may take, and than the pause before the first one or the shrinking of a failure.
const FOREVER: Duration = Duration::from_secs(300);

/// A file that is sound, and where its fields lie: first byte and bytes of each.
pub struct Seed {
    pub name: String,
    pub bytes: Vec<u8>,
    fields: Vec<(usize, usize)>,
}

impl Seed {
    pub fn new(name: String, bytes: Vec<u8>, dir: &Path) -> Seed {
        let path = dir.join("seed");
        fs::write(&path, &bytes).unwrap();
        // Header fields that are believed: LAS 1.4 R15, 2.4.
        let mut fields = vec![(24, 1), (25, 1), (94, 2), (96, 4), (100, 4), (104, 1), (105, 2), (107, 4)];
        fields.extend((131..227).step_by(8).map(|at| (at, 8)));
        fields.extend([(235, 8), (243, 4), (247, 8)]);
        if let Ok(file) = LidarFile::open(&path) {
            for vlr in &file.vlrs {
                let (at, len) = (vlr.offset as usize, vlr.len.min(600) as usize);
                fields.push(if vlr.extended { (at - 40, 8) } else { (at - 34, 2) });
                fields.push((at - if vlr.extended { 42 } else { 36 }, 2));
                if vlr.is("laszip encoded", 22204) {
                    fields.extend([(at, 2), (at + 2, 2), (at + 12, 4)]);
                    fields.extend((at + 32..at + len - 1).step_by(2).map(|at| (at, 2)));
                }
                if vlr.user_id == "copc" {
                    fields.extend((at..at + len - 7).step_by(8).map(|at| (at, 8)));
                    fields.extend((at..at + len - 3).step_by(4).map(|at| (at, 4)));
                }
            }
            let points = file.header.offset_to_points as usize;
            if file.header.compressed && points + 8 <= bytes.len() {
                fields.push((points, 8));
                let table = u64::from_le_bytes(bytes[points..points + 8].try_into().unwrap()) as usize;
                if table < bytes.len() {
                    fields.extend([(table, 4), (table + 4, 4)]);
                    fields.extend((table + 8..bytes.len()).take(40).map(|at| (at, 1)));
                }
            }
            for chunk in file.chunks.iter().take(20) {
                let head = chunk.byte_offset as usize + usize::from(file.header.record_len);
                fields.extend((0..14).map(|i| (head + 4 * i, 4)));
            }
        }
        fields.retain(|(at, len)| at + len <= bytes.len());
        Seed { name, bytes, fields }
    }
}

/// What is done to a file.
#[derive(Clone, Debug)]
pub enum Change {
    /// A field takes an extreme value.
    Field(Index, u64),
    /// A field takes a value close to its own.
    Near(Index, i8),
    /// One byte.
    Byte(Index, u8),
    /// A run of bytes takes one value.
    Fill(Index, u8, u8),
    /// Bytes are copied from one place to another.
    Copy(Index, Index, u8),
    /// Bytes go, what follows moves up.
    Remove(Index, u8),
    /// The end goes.
    Cut(Index),
}

pub fn change() -> impl Strategy<Value = Change> {
    let extreme = prop_oneof![
        prop::sample::select(vec![
            0,
            1,
            2,
            0x7f,
            0xff,
            0x7fff,
            0xffff,
            0x7fff_ffff,
            0x8000_0000,
            0xffff_fffe,
            0xffff_ffff,
            u64::MAX,
            u64::MAX - 1,
            i64::MAX as u64,
            i64::MIN as u64,
            1 << 40,
            f64::NAN.to_bits(),
            f64::INFINITY.to_bits(),
            (-1.0f64).to_bits(),
            1e300f64.to_bits(),
        ]),
        0..70_000u64,
        any::<u64>(),
    ];
    let at = || any::<Index>();
    prop_oneof![
        6 => (at(), extreme).prop_map(|(i, v)| Change::Field(i, v)),
        2 => (at(), any::<i8>()).prop_map(|(i, v)| Change::Near(i, v)),
        3 => (at(), any::<u8>()).prop_map(|(i, v)| Change::Byte(i, v)),
        1 => (at(), any::<u8>(), any::<u8>()).prop_map(|(i, n, v)| Change::Fill(i, n, v)),
        1 => (at(), at(), any::<u8>()).prop_map(|(i, j, n)| Change::Copy(i, j, n)),
        1 => (at(), any::<u8>()).prop_map(|(i, n)| Change::Remove(i, n)),
        1 => at().prop_map(Change::Cut),
    ]
}

pub fn apply(seed: &Seed, changes: &[Change]) -> Vec<u8> {
    let mut bytes = seed.bytes.clone();
    let set = |bytes: &mut Vec<u8>, (at, len): (usize, usize), value: u64| {
        if let Some(field) = bytes.get_mut(at..at + len) {
            field.copy_from_slice(&value.to_le_bytes()[..len]);
        }
    };
    for change in changes {
        let run = |start: usize, n: u8, len: usize| start..(start + usize::from(n)).min(len);
        match *change {
            _ if bytes.is_empty() => {}
            Change::Field(i, value) => set(&mut bytes, *i.get(&seed.fields), value),
            Change::Near(i, delta) => {
                let (at, len) = *i.get(&seed.fields);
                let mut raw = [0; 8];
                if let Some(field) = bytes.get(at..at + len) {
                    raw[..len].copy_from_slice(field);
                }
                let value = u64::from_le_bytes(raw).wrapping_add_signed(delta.into());
                set(&mut bytes, (at, len), value);
            }
            Change::Byte(i, value) => {
                let at = i.index(bytes.len());
                bytes[at] = value;
            }
            Change::Fill(i, n, value) => {
                let range = run(i.index(bytes.len()), n, bytes.len());
                bytes[range].fill(value);
            }
            Change::Copy(i, j, n) => {
                let from = run(i.index(bytes.len()), n, bytes.len());
                let to = j.index(bytes.len() - from.len() + 1);
                bytes.copy_within(from, to);
            }
            Change::Remove(i, n) => {
                let range = run(i.index(bytes.len()), n, bytes.len());
                bytes.drain(range);
            }
            Change::Cut(i) => bytes.truncate(i.index(bytes.len())),
        }
    }
    bytes
}

/// Made files of every kind, and small real ones. Seeds are opened once, by way of `dir`.
pub fn seeds(dir: &Path) -> Vec<Seed> {
    let mut seeds = Vec::new();
    for format in 0..=10u8 {
        let mut made = vec![
            Made::new(format, Packing::Plain, 50),
            Made::new(format, Packing::Fixed(40), 130).with_extra(3),
            Made::new(format, Packing::Variable(vec![30, 1, 60]), 91),
        ];
        if format < 6 {
            made.push(Made::new(format, Packing::PointWise, 90));
            made.push(Made::new(format, Packing::Fixed(40), 90).with_items(1));
        } else {
            made.push(Made::new(format, Packing::Copc(vec![30, 1, 60, 20]), 111));
            made.push(Made::new(format, Packing::Fixed(40), 90).with_items(4));
        }
        seeds.extend(made.iter().map(|m| Seed::new(format!("{m:?}"), m.bytes(), dir)));
    }
    let mut real = las_crate_files();
    real.extend(data_dir().iter().flat_map(|d| lidar_files(d)));
    for path in real {
        let bytes = fs::read(&path).unwrap();
        if bytes.len() < 120_000 {
            seeds.push(Seed::new(path.display().to_string(), bytes, dir));
        }
    }
    seeds
}

/// Tries `check` on broken files: a fixed set of `cases`, or other ones for `LASRAY_FUZZ_SECONDS`. The file of the
/// case under way lies in `target/tmp/NAME`, so that one which takes the process down is still there. Gives the
/// number of cases.
pub fn fuzz(name: &str, cases: u32, check: impl Fn(&Path, usize) -> Result<(), TestCaseError>) -> u64 {
    let dir: PathBuf = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    fs::create_dir_all(&dir).unwrap();
    let seeds = seeds(&dir);
    let path = dir.join("case.laz");
    let budget = std::env::var("LASRAY_FUZZ_SECONDS").ok().map(|s| Duration::from_secs(s.parse().unwrap()));
    let start = Instant::now();
    let tried = Arc::new(AtomicU64::new(0));
    watch(Arc::clone(&tried), path.clone());
    for round in 0.. {
        let rng_seed = if budget.is_some() { RngSeed::Random } else { RngSeed::Fixed(round) };
        let config = Config { cases, rng_seed, failure_persistence: None, ..Config::default() };
        let strategy = (any::<Index>(), prop::collection::vec(change(), 0..5));
        let result = TestRunner::new(config).run(&strategy, |(which, changes)| {
            let bytes = apply(which.get(&seeds), &changes);
            fs::write(&path, &bytes).unwrap();
            tried.fetch_add(1, Ordering::Relaxed);
            check(&path, bytes.len())
        });
        match result {
            Err(TestError::Fail(why, (which, changes))) => {
                let seed = which.get(&seeds);
                fs::write(&path, apply(seed, &changes)).unwrap();
                panic!("{why}\n{}\n{changes:?}\nits file: {}", seed.name, path.display());
            }
            other => other.unwrap(),
        }
        println!("{} seeds, {} cases in {:?}", seeds.len(), tried.load(Ordering::Relaxed), start.elapsed());
        if budget.is_none_or(|b| start.elapsed() > b) {
            break;
        }
    }
    tried.load(Ordering::Relaxed)
}

/// Ends the process when one case takes for ever: nothing else would tell which.
fn watch(tried: Arc<AtomicU64>, path: PathBuf) {
    std::thread::spawn(move || {
        let mut before = 0;
        loop {
            std::thread::sleep(FOREVER);
            let now = tried.load(Ordering::Relaxed);
            if now == before {
                eprintln!("case {now} does not end; its file: {}", path.display());
                std::process::abort();
            }
            before = now;
        }
    });
}
