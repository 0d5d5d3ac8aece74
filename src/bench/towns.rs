//! Files of the synthetic town that is read: made on all cores, and kept for the next run.
//!
//! A set of files lies in a folder of its own, `bench/town-…` in the user's cache folder, named by everything that makes
//! it: what was asked for, the program's version, and a digest of a small file that was made likewise, so that another
//! generator has other names. The folder gets its name when it is complete, with a list of its files, their sizes and
//! checksums (XXH3); what does not match its list is made again. The sets that were used least recently make room for others.

use super::failure::Stopped;
use crate::load;
use crate::synth::{Format, SynthError, Tile, Town, square, write_tile};
use anyhow::Context;
use serde::{Deserialize, Serialize};
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, SystemTime};
use tempfile::TempDir;
use xxhash_rust::xxh3::{Xxh3Default, xxh3_64};

/// Points in a square metre.
const DENSITY: f64 = 8.0;
/// Points of the small file whose digest names the generator.
const PROBE_POINTS: u64 = 2000;
/// Bytes that all kept sets together may take.
const MOST_BYTES: u64 = 8 << 30;
/// After so long nobody is still making what is unfinished.
const ABANDONED: Duration = Duration::from_secs(24 * 3600);
/// Folder of the sets within the cache folder, beginnings of theirs, and the list within each.
const FOLDER: &str = "bench";
const PREFIX: &str = "town-";
const UNFINISHED: &str = "part-";
const LIST: &str = "files.json";

/// Files of one town.
#[derive(Clone, Debug)]
pub struct Set {
    /// What their names begin with.
    pub name: &'static str,
    /// Of points.
    pub format: Format,
    /// LAZ instead of LAS.
    pub compress: bool,
    /// In tiles of some 320 m instead of one file.
    pub is_tiled: bool,
    /// Which town.
    pub seed: u64,
    /// In all files.
    pub points: u64,
}

/// A line of the list.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Listed {
    name: String,
    bytes: u64,
    digest: u64,
}

impl Set {
    fn extension(&self) -> &'static str {
        if self.compress { "laz" } else { "las" }
    }

    /// In the middle of the town.
    fn tiles(&self) -> Vec<Tile> {
        let side = (self.points as f64 / DENSITY).sqrt();
        let corner = [-side / 2.0; 2];
        if self.is_tiled {
            square(corner, side, self.points)
        } else {
            vec![Tile { corner, size: [side; 2], points: self.points }]
        }
    }

    fn names(&self) -> Vec<String> {
        let (name, extension) = (self.name, self.extension());
        if self.is_tiled {
            (0..self.tiles().len()).map(|k| format!("{name}{k:02}.{extension}")).collect()
        } else {
            vec![format!("{name}.{extension}")]
        }
    }

    fn write(&self, tile: &Tile, to: &Path, stop: &AtomicBool, wrote: impl FnMut(u64)) -> anyhow::Result<()> {
        let written = write_tile(&Town::new(self.seed), tile, to, self.format, self.compress, stop, wrote);
        written.map_err(|error| match error {
            SynthError::Stopped { .. } => Stopped.into(),
            error => error.into(),
        })
    }

    /// Name of the folder.
    fn key(&self) -> anyhow::Result<String> {
        let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
        let probe = folder.path().join("probe");
        let side = (PROBE_POINTS as f64 / DENSITY).sqrt();
        let tile = Tile { corner: [0.0; 2], size: [side; 2], points: PROBE_POINTS };
        self.write(&tile, &probe, &AtomicBool::new(false), |_| ())?;
        let mut bytes = fs::read(&probe).with_context(|| probe.display().to_string())?;
        // The day on which it was made (LAS 1.4 R15, 2.4).
        bytes.get_mut(90..94).into_iter().for_each(|day| day.fill(0));
        let Set { name, seed, points, .. } = self;
        let format = match self.format {
            Format::Three => 3,
            Format::Seven => 7,
        };
        let tiled = if self.is_tiled { "-tiles" } else { "" };
        let (version, extension, digest) = (env!("CARGO_PKG_VERSION"), self.extension(), xxh3_64(&bytes));
        Ok(format!(
            "{PREFIX}{version}-{name}-s{seed}-n{points}-d{DENSITY}-f{format}-{extension}{tiled}-{digest:016x}"
        ))
    }

    /// About what it takes, uncompressed.
    fn bytes(&self) -> u64 {
        self.points.saturating_mul(self.format.record_bytes() as u64)
    }

    /// The files in `folder`, if they are as they were made.
    fn kept(&self, folder: &Path) -> Option<Vec<PathBuf>> {
        let list: Vec<Listed> = serde_json::from_slice(&fs::read(folder.join(LIST)).ok()?).ok()?;
        if !list.iter().map(|listed| &listed.name).eq(&self.names()) {
            return None;
        }
        let file = |listed: Listed| {
            let path = folder.join(&listed.name);
            let is_long = path.metadata().is_ok_and(|metadata| metadata.len() == listed.bytes);
            (is_long && digest(&path).is_ok_and(|found| found == listed)).then_some(path)
        };
        list.into_iter().map(file).collect()
    }
}

fn digest(path: &Path) -> io::Result<Listed> {
    let mut file = File::open(path)?;
    let (mut buffer, mut bytes, mut digest) = (vec![0; 1 << 20], 0, Xxh3Default::new());
    loop {
        let read = file.read(&mut buffer)?;
        if read == 0 {
            break;
        }
        digest.update(&buffer[..read]);
        bytes += read as u64;
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Ok(Listed { name, bytes, digest: digest.digest() })
}

/// Where sets are kept, and those that are not kept.
pub struct Towns<'a> {
    kept: Option<PathBuf>,
    most_bytes: u64,
    temporary: Vec<TempDir>,
    quiet: bool,
    stop: &'a AtomicBool,
}

/// A set that is not there yet.
struct Making<'s> {
    at: usize,
    set: &'s Set,
    folder: TempDir,
    /// What the folder is called in the end.
    target: Option<PathBuf>,
}

impl<'a> Towns<'a> {
    /// `cache`: the user's cache folder; without one, sets last as long as this.
    pub fn new(cache: Option<&Path>, quiet: bool, stop: &'a AtomicBool) -> Towns<'a> {
        let kept = cache.map(|folder| folder.join(FOLDER));
        Towns { kept, most_bytes: MOST_BYTES, temporary: Vec::new(), quiet, stop }
    }

    /// The files of each of `sets`, kept ones or new ones.
    ///
    /// # Errors
    /// [`Stopped`], or a file that cannot be written in a temporary folder either.
    pub fn files(
        &mut self,
        sets: &[Set],
        progress: &mut dyn FnMut(&str),
    ) -> anyhow::Result<Vec<Vec<PathBuf>>> {
        match self.find_or_make(sets, progress) {
            Err(error) if self.kept.is_some() && !error.is::<Stopped>() => {
                progress(&format!("not kept: {error:#}"));
                self.kept = None;
                self.find_or_make(sets, progress)
            }
            result => result,
        }
    }

    fn find_or_make(
        &mut self,
        sets: &[Set],
        progress: &mut dyn FnMut(&str),
    ) -> anyhow::Result<Vec<Vec<PathBuf>>> {
        let mut files = vec![Vec::new(); sets.len()];
        let (mut missing, mut used) = (Vec::new(), Vec::new());
        for (at, set) in sets.iter().enumerate() {
            let target = match self.kept.as_ref().filter(|_| set.bytes() <= self.most_bytes) {
                Some(kept) => Some(kept.join(set.key()?)),
                None => None,
            };
            match target.as_deref().and_then(|folder| set.kept(folder)) {
                Some(found) => files[at] = found,
                None => missing.push((at, set, target.clone())),
            }
            if let Some(target) = target {
                touch(&target.join(LIST));
                used.push(target);
            }
        }
        if let Some(kept) = self.kept.as_ref().filter(|_| missing.iter().any(|(.., target)| target.is_some()))
        {
            fs::create_dir_all(kept).with_context(|| kept.display().to_string())?;
            let new = missing.iter().filter(|(.., target)| target.is_some()).map(|(_, set, _)| set.bytes());
            tidy(kept, self.most_bytes.saturating_sub(new.sum()), &used);
        }
        let mut making = Vec::new();
        for (at, set, target) in missing {
            progress(&format!("writing {} points as {}", set.points, set.extension()));
            let folder = match target.as_ref().and(self.kept.as_ref()) {
                Some(kept) => tempfile::Builder::new().prefix(UNFINISHED).tempdir_in(kept),
                None => tempfile::tempdir(),
            };
            let folder = folder.context("cannot make a temporary folder")?;
            making.push(Making { at, set, folder, target });
        }
        self.write(&making)?;
        for Making { at, set, folder, target } in making {
            let folder = self.put(set, folder, target)?;
            files[at] = set.names().iter().map(|name| folder.join(name)).collect();
        }
        Ok(files)
    }

    /// Writes all files, several at a time.
    fn write(&self, making: &[Making]) -> anyhow::Result<()> {
        let jobs = making.iter().flat_map(|making| {
            let paths = making.set.names().into_iter().map(|name| making.folder.path().join(name));
            making.set.tiles().into_iter().zip(paths).map(|(tile, path)| (making.set, tile, path))
        });
        let jobs: Vec<_> = jobs.collect();
        let points = jobs.iter().map(|(_, tile, _)| tile.points).sum();
        let bar = load::bar(points, self.quiet, "writing {wide_bar} {human_pos}/{human_len} points {eta}");
        let (next, failed) = (AtomicUsize::new(0), Mutex::new(None));
        std::thread::scope(|scope| {
            for _ in 0..load::threads().min(jobs.len()) {
                scope.spawn(|| {
                    while let Some((set, tile, path)) = jobs.get(next.fetch_add(1, Ordering::Relaxed)) {
                        if let Err(error) = set.write(tile, path, self.stop, |points| bar.inc(points)) {
                            // No other is begun.
                            next.fetch_max(jobs.len(), Ordering::Relaxed);
                            failed.lock().unwrap_or_else(|e| e.into_inner()).get_or_insert(error);
                            return;
                        }
                    }
                });
            }
        });
        bar.finish_and_clear();
        failed.into_inner().unwrap_or_else(|e| e.into_inner()).map_or(Ok(()), Err)
    }

    /// Gives a complete set its list and name; where it lies then.
    fn put(&mut self, set: &Set, folder: TempDir, target: Option<PathBuf>) -> anyhow::Result<PathBuf> {
        if let Some(target) = target {
            let list = set.names().into_iter().map(|name| digest(&folder.path().join(name)));
            let list = list.collect::<io::Result<Vec<_>>>().context("cannot read what was written")?;
            let text = serde_json::to_vec_pretty(&list)?;
            fs::write(folder.path().join(LIST), text).with_context(|| folder.path().display().to_string())?;
            // A damaged one may be there. What cannot be put in its place lasts as long as this.
            let _ = fs::remove_dir_all(&target);
            if fs::rename(folder.path(), &target).is_ok() {
                // Nothing of that name is left to be removed.
                let _ = folder.keep();
                return Ok(target);
            }
        }
        let path = folder.path().to_owned();
        self.temporary.push(folder);
        Ok(path)
    }
}

/// Marks a set as used now, where that is possible.
fn touch(list: &Path) {
    let _ = File::options().write(true).open(list).and_then(|file| file.set_modified(SystemTime::now()));
}

/// Removes what was used least recently until the rest is at most `most_bytes`, and what was never finished; `used` stays.
/// What cannot be removed stays too.
fn tidy(kept: &Path, most_bytes: u64, used: &[PathBuf]) {
    let Ok(entries) = fs::read_dir(kept) else { return };
    let mut sets = Vec::new();
    for path in entries.flatten().map(|entry| entry.path()) {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let modified = |path: &Path| path.metadata().and_then(|metadata| metadata.modified());
        if name.starts_with(UNFINISHED) {
            let age = modified(&path).ok().and_then(|modified| modified.elapsed().ok());
            if age.is_some_and(|age| age > ABANDONED) {
                let _ = fs::remove_dir_all(&path);
            }
        } else if name.starts_with(PREFIX) {
            let files = fs::read_dir(&path).into_iter().flatten().flatten();
            let bytes: u64 = files.filter_map(|file| Some(file.metadata().ok()?.len())).sum();
            sets.push((modified(&path.join(LIST)).unwrap_or(SystemTime::UNIX_EPOCH), bytes, path));
        }
    }
    sets.sort();
    let mut all: u64 = sets.iter().map(|(_, bytes, _)| bytes).sum();
    for (_, bytes, path) in sets {
        if all > most_bytes && !used.contains(&path) && fs::remove_dir_all(&path).is_ok() {
            all -= bytes;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SET: Set = Set {
        name: "town",
        format: Format::Seven,
        compress: false,
        is_tiled: true,
        seed: 1,
        points: 900_000,
    };

    #[test]
    fn sets_are_kept_and_damaged_ones_made_anew() {
        let cache = tempfile::tempdir().unwrap();
        let stop = AtomicBool::new(false);
        let set = Set { points: 3000, is_tiled: false, ..SET };
        let get = |most_bytes, sets: &[Set]| {
            let (mut written, mut towns) = (0, Towns::new(Some(cache.path()), true, &stop));
            towns.most_bytes = most_bytes;
            let files = towns.files(sets, &mut |_| written += 1).unwrap();
            assert!(files.iter().flatten().all(|file| file.is_file()));
            (files, written)
        };
        let (files, written) = get(MOST_BYTES, std::slice::from_ref(&set));
        assert_eq!((written, files[0].len()), (1, 1));
        assert_eq!(get(MOST_BYTES, std::slice::from_ref(&set)), (files.clone(), 0));
        let whole = fs::read(&files[0][0]).unwrap();
        let mut flipped = whole.clone();
        flipped[whole.len() - 5] ^= 1;
        for damaged in [&flipped[..], &whole[..whole.len() - 34], b""] {
            fs::write(&files[0][0], damaged).unwrap();
            assert_eq!(get(MOST_BYTES, std::slice::from_ref(&set)), (files.clone(), 1));
            assert!(fs::read(&files[0][0]).unwrap().len() == whole.len());
        }
        fs::write(files[0][0].with_file_name(LIST), "[").unwrap();
        assert_eq!(get(MOST_BYTES, std::slice::from_ref(&set)).1, 1);
        // Everything that makes a file names it.
        let others = [
            Set { seed: 2, ..set.clone() },
            Set { points: 3001, ..set.clone() },
            Set { compress: true, ..set.clone() },
            Set { format: Format::Three, ..set.clone() },
        ];
        assert_eq!(get(MOST_BYTES, &others).1, 4);
        assert_eq!(get(MOST_BYTES, &others).1, 0);
        // Room for one and a half: the newest alone stays, and what has no room is not kept.
        let other = Set { seed: 3, ..set.clone() };
        assert_eq!(get(set.bytes() * 3 / 2, std::slice::from_ref(&other)).1, 1);
        let folders = || fs::read_dir(cache.path().join(FOLDER)).unwrap().count();
        assert_eq!(folders(), 1);
        assert_eq!(get(1000, std::slice::from_ref(&set)).1, 1);
        assert_eq!(folders(), 1);
    }

    #[test]
    fn tiles_are_one_set_and_a_stop_leaves_nothing() {
        let cache = tempfile::tempdir().unwrap();
        let set = Set { points: 2_000_000, ..SET };
        assert!(set.tiles().len() > 1 && set.names()[1] == "town01.las");
        let stop = AtomicBool::new(true);
        let error = Towns::new(Some(cache.path()), true, &stop).files(&[set], &mut |_| ()).unwrap_err();
        assert!(error.is::<Stopped>());
        assert_eq!(fs::read_dir(cache.path().join(FOLDER)).unwrap().count(), 0);
    }

    #[test]
    fn without_a_place_to_keep_them_they_are_temporary() {
        let folder = tempfile::tempdir().unwrap();
        let in_the_way = folder.path().join("file");
        fs::write(&in_the_way, "").unwrap();
        let stop = AtomicBool::new(false);
        let mut towns = Towns::new(Some(&in_the_way), true, &stop);
        let mut said = Vec::new();
        let files =
            towns.files(&[Set { points: 900, ..SET }], &mut |what| said.push(what.to_owned())).unwrap();
        assert!(said[0].starts_with("not kept: "), "{said:?}");
        assert!(files[0][0].is_file());
        drop(towns);
        assert!(!files[0][0].exists());
    }
}
