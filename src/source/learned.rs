//! What was learned of files, kept in the user's cache folder: the bounds of each chunk's points, so that the next view
//! reads only what it touches, and how many points there are of each kind. Never needed: where something is missing, wrong or cannot be written, files are read as
//! if there were no cache.
//!
//! One file for each input, named by a hash of its path, little endian:
//!
//! | bytes | |
//! |---|---|
//! | 8 | "LASRAYCB" |
//! | 4, 4 | version, bytes of the path |
//! | 8, 8 | size of the input, its time of modification in nanoseconds since 1970 |
//! | 8, 8 | digest of its header and of where its chunks lie, chunks |
//! | … | its path |
//! | 24 each | raw bounds of the chunks: least X, Y, Z, largest X, Y, Z; not known: least above largest |
//! | 8 each | points of each kind: class << 56 \| flags << 52 \| how many; none: they were not counted to the end |
//! | 8 | XXH3 of all before |
//!
//! Entries are written whole or not at all.

use super::LidarFile;
use super::known::{Known, RawBounds, Told};
use crate::attribute::{Flags, Kind};
use std::collections::BTreeMap;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;
use xxhash_rust::xxh3::{xxh3_64, xxh3_128};

const MAGIC: &[u8; 8] = b"LASRAYCB";
const VERSION: u32 = 3;
/// Bytes of a chunk's bounds.
const BOUNDS: usize = 24;
/// Bytes of the number of points of a kind.
const COUNT: usize = 8;
/// Where in it the kind is.
const KIND_SHIFT: u32 = 52;
/// Most kinds that there are.
const MOST_KINDS: usize = 256 * Flags::SETS;
/// Bytes of the checksum.
const SUM: usize = 8;
/// Bytes that all entries together may take.
const MOST_BYTES: u64 = 256 << 20;
/// An entry is at most this part of its input: of tiny chunks none is kept.
const LEAST_RATIO: u64 = 2000;
/// Names the folder, in the place of the user's cache folder.
const VARIABLE: &str = "LASRAY_CACHE";

/// Points of each kind.
pub type Counts = BTreeMap<Kind, u64>;

/// What is kept of a file.
#[derive(Debug, Default, PartialEq)]
struct Kept {
    bounds: Vec<Option<RawBounds>>,
    kinds: Counts,
}

/// A folder of entries.
#[derive(Clone, Debug)]
pub struct Cache {
    folder: PathBuf,
    most_bytes: u64,
}

impl Cache {
    /// The user's: the folder that `LASRAY_CACHE` names, or `lasray` in the system's place for such things.
    pub fn of_user() -> Option<Cache> {
        use etcetera::base_strategy::{BaseStrategy, choose_native_strategy};
        if let Some(folder) = std::env::var_os(VARIABLE).filter(|folder| !folder.is_empty()) {
            return Some(Cache::at(folder.into()));
        }
        Some(Cache::at(choose_native_strategy().ok()?.cache_dir().join("lasray")))
    }

    /// In a folder, which is made when there is something to write.
    pub fn at(folder: PathBuf) -> Cache {
        Cache { folder, most_bytes: MOST_BYTES }
    }

    /// The folder, in which others may keep things, too.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The same with room for so many bytes.
    pub fn with_room(self, most_bytes: u64) -> Cache {
        Cache { most_bytes, ..self }
    }

    /// What was learned of where the points of a file lie, where that is of this very file and within its header's bounds.
    pub fn load(&self, file: &LidarFile) -> Known {
        self.load_all(file).0
    }

    /// The same, and how many points there are of each kind; empty: that is not known.
    pub fn load_all(&self, file: &LidarFile) -> (Known, Counts) {
        let Some(entry) = Entry::of(&self.folder, file) else { return Default::default() };
        let Kept { mut bounds, kinds } = entry.read(file).unwrap_or_default();
        for of_chunk in &mut bounds {
            *of_chunk = of_chunk.filter(|bounds| bounds.in_header(&file.header));
        }
        (Known::new(Told::Cache, bounds), kinds)
    }

    /// Keeps what was learned of a file, beside what is kept of it already.
    pub fn save(&self, file: &LidarFile, learned: &[Option<RawBounds>]) -> io::Result<()> {
        self.save_all(file, learned, &Counts::new())
    }

    /// The same, with the points of each kind; empty: that is not known.
    pub fn save_all(
        &self,
        file: &LidarFile,
        learned: &[Option<RawBounds>],
        kinds: &Counts,
    ) -> io::Result<()> {
        let Some(entry) = Entry::of(&self.folder, file) else { return Ok(()) };
        let nothing = || Kept { bounds: vec![None; file.chunks.len()], kinds: Counts::new() };
        let old = entry.read(file).unwrap_or_else(nothing);
        let bounds = old.bounds.iter().zip(learned).map(|(old, new)| new.or(*old)).collect();
        let len = (entry.len(file.chunks.len()) + COUNT * kinds.len()) as u64;
        let is_worth_it = !kinds.is_empty() && len.saturating_mul(LEAST_RATIO) <= file.bytes.len();
        let kinds = if is_worth_it { kinds } else { &old.kinds };
        let merged = Kept { bounds, kinds: kinds.clone() };
        if merged == old || merged.bounds.len() != file.chunks.len() {
            return Ok(());
        }
        fs::create_dir_all(&self.folder)?;
        entry.write(&merged)
    }

    /// Drops what is kept of a file.
    pub fn forget(&self, file: &LidarFile) {
        if let Some(entry) = Entry::of(&self.folder, file) {
            // What is not there is forgotten.
            let _ = fs::remove_file(entry.path);
        }
    }

    /// Removes the oldest entries until the others fit.
    pub fn tidy(&self) -> io::Result<()> {
        let entries = fs::read_dir(&self.folder)?.flatten();
        let about = |entry: fs::DirEntry| {
            let metadata = entry.metadata().ok().filter(fs::Metadata::is_file)?;
            Some((metadata.modified().ok()?, metadata.len(), entry.path()))
        };
        let mut entries: Vec<_> = entries.filter_map(about).filter(|(_, _, path)| is_ours(path)).collect();
        entries.sort();
        let mut bytes: u64 = entries.iter().map(|(_, bytes, _)| bytes).sum();
        for (_, of_entry, path) in entries {
            if bytes <= self.most_bytes {
                break;
            }
            fs::remove_file(path)?;
            bytes -= of_entry;
        }
        Ok(())
    }
}

const EXTENSION: &str = "bounds";
const UNFINISHED: &str = "part";
/// What the names of those begin with.
const PREFIX: &str = "lasray-";

/// Whether a file in the folder is of this making: others may lie there, too.
fn is_ours(path: &Path) -> bool {
    let is_hash = |stem: &str| stem.len() == 32 && stem.bytes().all(|byte| byte.is_ascii_hexdigit());
    let stem = path.file_stem().and_then(|stem| stem.to_str()).unwrap_or_default();
    match path.extension() {
        Some(extension) if extension == EXTENSION => is_hash(stem),
        Some(extension) if extension == UNFINISHED => stem.starts_with(PREFIX),
        _ => false,
    }
}

/// The place of a file's entry, and what it must begin with.
struct Entry {
    path: PathBuf,
    key: Vec<u8>,
}

impl Entry {
    /// `None` for a file of which nothing is kept.
    fn of(folder: &Path, file: &LidarFile) -> Option<Entry> {
        let path = fs::canonicalize(file.path()).ok()?;
        let path = path.as_os_str().as_encoded_bytes();
        let modified = file.bytes.modified()?.duration_since(SystemTime::UNIX_EPOCH).ok()?;
        let mut key = MAGIC.to_vec();
        key.extend(VERSION.to_le_bytes());
        key.extend((path.len() as u32).to_le_bytes());
        key.extend(file.bytes.len().to_le_bytes());
        key.extend((modified.as_nanos() as u64).to_le_bytes());
        key.extend(file.digest().to_le_bytes());
        key.extend((file.chunks.len() as u64).to_le_bytes());
        key.extend(path);
        let name = format!("{:032x}.{EXTENSION}", xxh3_128(path));
        let entry = Entry { path: folder.join(name), key };
        // Where the only chunk lies, the header says.
        let is_worth_it = file.chunks.len() > 1
            && (entry.len(file.chunks.len()) as u64).saturating_mul(LEAST_RATIO) <= file.bytes.len();
        is_worth_it.then_some(entry)
    }

    fn len(&self, chunks: usize) -> usize {
        self.key.len() + BOUNDS * chunks + SUM
    }

    fn read(&self, file: &LidarFile) -> Option<Kept> {
        let least = self.len(file.chunks.len());
        let is_len = |len: u64| (least as u64..=(least + MOST_KINDS * COUNT) as u64).contains(&len);
        if !is_len(fs::metadata(&self.path).ok()?.len()) {
            return None;
        }
        let raw = fs::read(&self.path).ok()?;
        if !is_len(raw.len() as u64) || !raw.starts_with(&self.key) {
            return None;
        }
        let (body, sum) = raw.split_at(raw.len() - SUM);
        if xxh3_64(body).to_le_bytes() != sum {
            return None;
        }
        let (of_chunks, of_kinds) = body[self.key.len()..].split_at(BOUNDS * file.chunks.len());
        let (words, []) = of_kinds.as_chunks::<COUNT>() else { return None };
        let count = |word: &[u8; COUNT]| {
            let word = u64::from_le_bytes(*word);
            let kind = word >> KIND_SHIFT;
            (((kind >> 4) as u8, Flags::of(kind as u8)), word & ((1 << KIND_SHIFT) - 1))
        };
        let kinds: Counts = words.iter().map(count).collect();
        let bounds = |raw: &[u8]| {
            let at = |k: usize| i32::from_le_bytes([raw[k], raw[k + 1], raw[k + 2], raw[k + 3]]);
            let bounds = RawBounds { min: [at(0), at(4), at(8)], max: [at(12), at(16), at(20)] };
            bounds.is_sound().then_some(bounds)
        };
        Some(Kept { bounds: of_chunks.chunks_exact(BOUNDS).map(bounds).collect(), kinds })
    }

    fn write(&self, Kept { bounds, kinds }: &Kept) -> io::Result<()> {
        let mut raw = self.key.clone();
        for bounds in bounds {
            let RawBounds { min, max } = bounds.unwrap_or(RawBounds::NOTHING);
            raw.extend(min.into_iter().chain(max).flat_map(i32::to_le_bytes));
        }
        for (&(class, flags), points) in kinds {
            let kind = u64::from(class) << 4 | u64::from(flags.bits());
            raw.extend((kind << KIND_SHIFT | points).to_le_bytes());
        }
        raw.extend(xxh3_64(&raw).to_le_bytes());
        let folder = self.path.parent().unwrap_or(Path::new("."));
        let mut file =
            tempfile::Builder::new().prefix(PREFIX).suffix(&format!(".{UNFINISHED}")).tempfile_in(folder)?;
        // A power cut may leave less than that: the checksum tells.
        file.write_all(&raw)?;
        file.persist(&self.path).map_err(|error| error.error)?;
        Ok(())
    }
}
