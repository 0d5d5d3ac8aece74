//! The pipeline cache of a device, and its file in the user's cache folder: many drivers compile for a second at each
//! start otherwise. Never needed: what is missing, damaged or another driver's is as if there were none.
//!
//! One file for each device, named by vendor and device, little endian:
//!
//! | bytes | |
//! |---|---|
//! | 8 | "LASRAYPC" |
//! | 4, 4, 4, 4 | version of this layout, vendor, device, version of the driver |
//! | 16 | `pipelineCacheUUID` |
//! | … | what the driver gave (`vkGetPipelineCacheData`) |
//! | 8 | XXH3 of all before |
//!
//! It is written whole or not at all.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use ash::vk;
use xxhash_rust::xxh3::xxh3_64;

const MAGIC: &[u8; 8] = b"LASRAYPC";
const VERSION: u32 = 1;
/// Bytes of the checksum.
const SUM_BYTES: usize = 8;
/// Bytes of what a driver gives that holds no pipeline: a `VkPipelineCacheHeaderVersionOne`.
const BARE_BYTES: usize = 32;
/// Most bytes of a file. Pipelines of versions that are gone pile up in it: when it is full it is emptied.
const MAX_FILE_BYTES: usize = 32 << 20;
/// What the folder's other files are named like while they are being written, so that what a crash leaves is found.
const UNFINISHED: [&str; 2] = ["lasray-", ".part"];

/// What compiling leaves behind, for the pipelines that are compiled after it; the driver lets any thread use it.
pub(super) struct PipelineCache {
    /// Null where the driver makes none: pipelines are compiled as well without.
    handle: vk::PipelineCache,
    file: Option<CacheFile>,
    /// A pipeline was compiled that may not be in the file.
    has_compiled: AtomicBool,
}

impl PipelineCache {
    /// For the device of `properties`, with what its file in `folder` holds; `None`: no file.
    pub fn new(
        device: &ash::Device,
        properties: &vk::PhysicalDeviceProperties,
        folder: Option<&Path>,
    ) -> PipelineCache {
        let mut file = folder.map(|folder| CacheFile::of(folder, properties));
        let data = file.as_mut().and_then(CacheFile::load).unwrap_or_default();
        let create = |data: &[u8]| {
            let create = vk::PipelineCacheCreateInfo::default().initial_data(data);
            // SAFETY: the device is alive; the data is what its driver wrote: whose it is, and its checksum, were
            // looked at.
            unsafe { device.create_pipeline_cache(&create, None) }
        };
        let handle = create(&data).or_else(|_| create(&[])).unwrap_or(vk::PipelineCache::null());
        PipelineCache { handle, file, has_compiled: AtomicBool::new(false) }
    }

    pub fn handle(&self) -> vk::PipelineCache {
        self.handle
    }

    /// A pipeline was compiled: the file is written at the end.
    pub fn note_compiled(&self) {
        self.has_compiled.store(true, Ordering::Relaxed);
    }

    /// Writes the file if there may be something new, and destroys the cache.
    ///
    /// # Safety
    /// The cache is of `device`, no pipeline is being compiled, and it is not used afterwards.
    pub unsafe fn close(&mut self, device: &ash::Device) {
        if let Some(file) = self.file.as_ref().filter(|_| *self.has_compiled.get_mut())
            && self.handle != vk::PipelineCache::null()
            // SAFETY: the cache is alive: the caller's promise.
            && let Ok(data) = unsafe { device.get_pipeline_cache_data(self.handle) }
            && let Err(e) = file.save(&data)
        {
            tracing::debug!("compiled pipelines are not kept: {e}");
        }
        // SAFETY: the caller's promise. A null handle is allowed.
        unsafe { device.destroy_pipeline_cache(self.handle, None) };
    }
}

/// The file of a device's pipeline cache.
struct CacheFile {
    path: PathBuf,
    /// What the file must begin with.
    key: Vec<u8>,
    /// Digest of the data that was there.
    loaded: Option<u64>,
}

impl CacheFile {
    /// For the device of `properties`, in `folder`.
    pub fn of(folder: &Path, properties: &vk::PhysicalDeviceProperties) -> CacheFile {
        let vk::PhysicalDeviceProperties { vendor_id, device_id, driver_version, .. } = *properties;
        let mut key = MAGIC.to_vec();
        for number in [VERSION, vendor_id, device_id, driver_version] {
            key.extend(number.to_le_bytes());
        }
        key.extend(properties.pipeline_cache_uuid);
        CacheFile {
            path: folder.join(format!("{vendor_id:08x}-{device_id:08x}.pipelines")),
            key,
            loaded: None,
        }
    }

    /// What this very driver wrote. Not a bare header: there is no pipeline in it, and SwiftShader gives all that
    /// it took behind its own, more in each run.
    pub fn load(&mut self) -> Option<Vec<u8>> {
        let least = self.key.len() + SUM_BYTES;
        let len = fs::metadata(&self.path).ok().filter(fs::Metadata::is_file)?.len();
        if !(least as u64..=MAX_FILE_BYTES as u64).contains(&len) {
            return None;
        }
        let raw = fs::read(&self.path).ok().filter(|raw| raw.len() >= least && raw.starts_with(&self.key))?;
        let (body, sum) = raw.split_at(raw.len() - SUM_BYTES);
        if xxh3_64(body).to_le_bytes() != sum {
            return None;
        }
        let data = body[self.key.len()..].to_vec();
        self.loaded = Some(xxh3_64(&data));
        Some(data).filter(|data| data.len() > BARE_BYTES)
    }

    /// Writes `data`, unless that is what was loaded.
    pub fn save(&self, data: &[u8]) -> io::Result<()> {
        if self.loaded == Some(xxh3_64(data)) {
            return Ok(());
        }
        if self.key.len() + data.len() + SUM_BYTES > MAX_FILE_BYTES {
            return match fs::remove_file(&self.path) {
                Err(e) if e.kind() != io::ErrorKind::NotFound => Err(e),
                _ => Ok(()),
            };
        }
        let folder = self.path.parent().unwrap_or(Path::new("."));
        fs::create_dir_all(folder)?;
        let mut raw = [&self.key, data].concat();
        raw.extend(xxh3_64(&raw).to_le_bytes());
        let [prefix, suffix] = UNFINISHED;
        let mut file = tempfile::Builder::new().prefix(prefix).suffix(suffix).tempfile_in(folder)?;
        // A power cut may leave less than that: the checksum tells.
        file.write_all(&raw)?;
        file.persist(&self.path).map_err(|error| error.error)?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn properties() -> vk::PhysicalDeviceProperties {
        let (vendor_id, device_id, driver_version) = (0x1002, 0x73bf, 7);
        vk::PhysicalDeviceProperties { vendor_id, device_id, driver_version, ..Default::default() }
    }

    fn load(folder: &Path, properties: &vk::PhysicalDeviceProperties) -> Option<Vec<u8>> {
        CacheFile::of(folder, properties).load()
    }

    #[test]
    fn what_is_written_is_there_again_for_this_driver_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("in").join("it");
        assert_eq!(load(&path, &properties()), None);
        CacheFile::of(&path, &properties()).save(&[7; 1000]).unwrap();
        assert_eq!(load(&path, &properties()), Some(vec![7; 1000]));
        let mut other_uuid = properties();
        other_uuid.pipeline_cache_uuid[15] = 1;
        let newer = vk::PhysicalDeviceProperties { driver_version: 8, ..properties() };
        let other_device = vk::PhysicalDeviceProperties { device_id: 1, ..properties() };
        for other in [other_uuid, newer, other_device] {
            assert_eq!(load(&path, &other), None);
        }
        // The driver was replaced: its pipelines take the place of the old ones.
        CacheFile::of(&path, &newer).save(&[8; 40]).unwrap();
        assert_eq!((load(&path, &newer), load(&path, &properties())), (Some(vec![8; 40]), None));
        assert_eq!(fs::read_dir(&path).unwrap().count(), 1);
    }

    #[test]
    fn a_bare_header_is_neither_used_nor_written_again() {
        let folder = tempfile::tempdir().unwrap();
        CacheFile::of(folder.path(), &properties()).save(&[7; BARE_BYTES]).unwrap();
        let mut file = CacheFile::of(folder.path(), &properties());
        assert_eq!(file.load(), None);
        fs::remove_file(&file.path).unwrap();
        file.save(&[7; BARE_BYTES]).unwrap();
        assert!(!file.path.exists());
        file.save(&[7; BARE_BYTES + 1]).unwrap();
        assert!(file.path.exists());
    }

    #[test]
    fn what_is_damaged_is_not_used() {
        let folder = tempfile::tempdir().unwrap();
        let file = CacheFile::of(folder.path(), &properties());
        file.save(&[7; 100]).unwrap();
        let whole = fs::read(&file.path).unwrap();
        for at in 0..whole.len() {
            let mut damaged = whole.clone();
            damaged[at] ^= 4;
            fs::write(&file.path, damaged).unwrap();
            assert_eq!(load(folder.path(), &properties()), None, "byte {at}");
            fs::write(&file.path, &whole[..at]).unwrap();
            assert_eq!(load(folder.path(), &properties()), None, "cut at {at}");
        }
        fs::write(&file.path, &whole).unwrap();
        assert_eq!(load(folder.path(), &properties()), Some(vec![7; 100]));
    }

    #[test]
    fn it_is_written_when_there_is_something_new_and_never_grows_without_bound() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = CacheFile::of(folder.path(), &properties());
        file.save(&[1; 100]).unwrap();
        file.load().unwrap();
        fs::remove_file(&file.path).unwrap();
        file.save(&[1; 100]).unwrap();
        assert!(!file.path.exists(), "nothing was new");
        file.save(&[2; 100]).unwrap();
        assert!(file.path.exists());
        file.save(&vec![1; MAX_FILE_BYTES]).unwrap();
        assert!(!file.path.exists(), "what is too large begins anew");
        file.save(&vec![1; MAX_FILE_BYTES]).unwrap();
    }
}
