//! How far every payload is: what host memory has of it, what the device has, and whether that is of the files as they
//! are. What the policy asks, put together in one place.

use super::host_cache::HostCache;
use super::policy::{Device, Memory, SectionState, States};
use super::scene::{Scene, Upload};
use crate::gpu::GpuError;
use crate::limits::LIMITS;
use crate::section::PayloadKey;
use std::collections::{HashMap, HashSet};

/// What is known of payloads beside what the scene knows.
pub struct Payloads {
    /// Those in host memory.
    pub cache: HostCache,
    /// On the device, but of the files as they were.
    stale: HashSet<PayloadKey>,
    /// Some of them may not be on the device.
    has_new_stale: bool,
    /// When one was wanted or shown last.
    used: HashMap<PayloadKey, u64>,
    tick: u64,
}

impl Payloads {
    /// Nothing is known yet. `most_copied_bytes`: of copies in host memory.
    pub fn new(most_copied_bytes: u64) -> Payloads {
        Payloads {
            cache: HostCache::new(most_copied_bytes),
            stale: HashSet::new(),
            has_new_stale: false,
            used: HashMap::new(),
            tick: 0,
        }
    }

    /// Another tick begins.
    pub fn begin_tick(&mut self) {
        self.tick += 1;
    }

    /// Nothing is stale that the device does not have. Call it when the files' changes have been applied.
    pub fn trim_stale(&mut self, scene: &Scene) {
        if std::mem::take(&mut self.has_new_stale) {
            self.stale.retain(|&key| scene.is_published(key) || scene.is_uploading(key));
        }
    }

    /// The number of the tick.
    pub fn tick(&self) -> u64 {
        self.tick
    }

    /// These are wanted or shown now.
    pub fn touch<'a>(&mut self, keys: impl IntoIterator<Item = &'a PayloadKey>) {
        self.used.extend(keys.into_iter().map(|&key| (key, self.tick)));
    }

    /// Forgets when payloads were used that are nowhere any more, once there are many.
    pub fn trim(&mut self, scene: &Scene) {
        if self.used.len() > LIMITS.remembered_uses {
            let (cache, now) = (&self.cache, self.tick);
            let is_on_device = |key| scene.is_published(key) || scene.is_uploading(key);
            self.used.retain(|&key, used| *used == now || cache.get(key).is_some() || is_on_device(key));
        }
    }

    /// Everything of which something is known.
    pub fn known(&self) -> HashSet<PayloadKey> {
        self.cache.known().chain(self.used.keys().copied()).collect()
    }

    /// The files hold something else there by now: what host memory has is forgotten, what the device has is stale.
    pub fn outdate(&mut self, keys: impl IntoIterator<Item = PayloadKey>) {
        for key in keys {
            self.cache.forget(key);
            self.stale.insert(key);
        }
        self.has_new_stale = true;
    }

    /// What the device has of this is older than what has arrived.
    pub fn replace(&mut self, key: PayloadKey) {
        self.stale.insert(key);
    }

    /// What is on the device, but of the files as they were.
    pub fn stale(&self) -> impl Iterator<Item = PayloadKey> {
        self.stale.iter().copied()
    }

    /// Takes payloads off the device.
    pub fn evict(&mut self, scene: &mut Scene, keys: &[PayloadKey]) -> Result<(), GpuError> {
        keys.iter().for_each(|key| {
            self.stale.remove(key);
        });
        scene.evict(keys)
    }

    /// With what the scene knows.
    pub fn on<'a>(&'a self, scene: &'a Scene) -> OnDevice<&'a Payloads, &'a Scene> {
        OnDevice { payloads: self, scene }
    }

    /// The same, to be changed.
    pub fn on_mut<'a>(&'a mut self, scene: &'a mut Scene) -> OnDevice<&'a mut Payloads, &'a mut Scene> {
        OnDevice { payloads: self, scene }
    }
}

/// Host and device together.
pub struct OnDevice<P, S> {
    payloads: P,
    scene: S,
}

impl<P: AsRef<Payloads>, S: AsRef<Scene>> States for OnDevice<P, S> {
    fn state(&self, key: PayloadKey) -> SectionState {
        let (payloads, scene) = (self.payloads.as_ref(), self.scene.as_ref());
        let device = match (scene.is_published(key), scene.is_uploading(key)) {
            (false, false) => Device::Absent,
            (false, true) => Device::Uploading,
            (true, false) => Device::Published,
            (true, true) => Device::Replacing,
        };
        SectionState {
            host: payloads.cache.host(key),
            device,
            is_stale: payloads.stale.contains(&key),
            last_used: payloads.used.get(&key).copied().unwrap_or(0),
        }
    }

    fn bytes(&self, key: PayloadKey) -> [u64; 2] {
        let payload = self.payloads.as_ref().cache.get(key);
        payload.map_or([0; 2], |payload| [payload.uploaded_bytes(), payload.device_bytes()])
    }

    fn resident_bytes(&self, key: PayloadKey) -> u64 {
        self.scene.as_ref().bytes_of(key)
    }

    fn resident(&self) -> Vec<PayloadKey> {
        self.scene.as_ref().resident().collect()
    }

    fn arrived(&self) -> Vec<PayloadKey> {
        self.payloads.as_ref().cache.arrived().collect()
    }
}

impl Memory for OnDevice<&mut Payloads, &mut Scene> {
    type Error = GpuError;

    fn try_upload(&mut self, key: PayloadKey) -> Result<Upload, GpuError> {
        let payload = self.payloads.cache.get(key).expect("only what is in host memory is uploaded");
        let upload = self.scene.try_upload(key, payload)?;
        if upload == Upload::Started {
            self.payloads.stale.remove(&key);
            self.keep(key);
        }
        Ok(upload)
    }

    fn evict(&mut self, keys: &[PayloadKey]) -> Result<(), GpuError> {
        self.payloads.evict(self.scene, keys)
    }

    fn keep(&mut self, key: PayloadKey) {
        let payloads = &mut *self.payloads;
        let last_used = payloads.used.get(&key).copied().unwrap_or(0);
        payloads.cache.keep(key, last_used, payloads.tick);
    }
}

impl AsRef<Payloads> for Payloads {
    fn as_ref(&self) -> &Payloads {
        self
    }
}

impl AsRef<Scene> for Scene {
    fn as_ref(&self) -> &Scene {
        self
    }
}
