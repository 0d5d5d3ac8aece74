//! Payloads in host memory: those that have arrived and wait to be uploaded, and copies of those that were, from which
//! the device can be given back what it had to give up.
//!
//! A payload is [inserted](HostCache::insert) when it arrives, and [kept](HostCache::keep) once it has been uploaded or is
//! not wanted any more; copies that were used longest ago go first. What the files hold differently by now is
//! [forgotten](HostCache::forget).

use super::policy::Host;
use crate::section::{Payload, PayloadKey, PayloadKind};
use std::collections::{HashMap, HashSet};
use std::sync::Arc;

/// A copy of what was uploaded.
struct Copied {
    payload: Arc<Payload>,
    /// When it was used last.
    used: u64,
}

/// See the module.
pub struct HostCache {
    arrived: HashMap<PayloadKey, Arc<Payload>>,
    copies: HashMap<PayloadKey, Copied>,
    /// Known to hold no point.
    empty: HashSet<PayloadKey>,
    /// Some of their points could not be read.
    damaged: HashSet<PayloadKey>,
    copied_bytes: u64,
    most_copied_bytes: u64,
}

impl HostCache {
    /// Copies take `most_copied_bytes` at most; what has arrived is limited by whoever inserts it.
    pub fn new(most_copied_bytes: u64) -> HostCache {
        HostCache {
            arrived: HashMap::new(),
            copies: HashMap::new(),
            empty: HashSet::new(),
            damaged: HashSet::new(),
            copied_bytes: 0,
            most_copied_bytes,
        }
    }

    /// Keeps no copies from now on.
    pub fn keep_no_copies(&mut self) {
        self.most_copied_bytes = 0;
    }

    /// A payload has arrived; `None`: it holds no point.
    pub fn insert(&mut self, key: PayloadKey, payload: Option<Arc<Payload>>, is_damaged: bool) {
        if is_damaged {
            self.damaged.insert(key);
        }
        match payload {
            Some(payload) => {
                self.arrived.insert(key, payload);
            }
            None => {
                self.empty.insert(key);
            }
        }
    }

    /// What is there to be uploaded.
    pub fn get(&self, key: PayloadKey) -> Option<&Arc<Payload>> {
        self.arrived.get(&key).or_else(|| self.copies.get(&key).map(|copied| &copied.payload))
    }

    /// What is known of a payload here.
    pub fn host(&self, key: PayloadKey) -> Host {
        if self.arrived.contains_key(&key) {
            Host::Arrived
        } else if self.copies.contains_key(&key) {
            Host::Copied
        } else if self.empty.contains(&key) {
            Host::Empty
        } else {
            Host::Absent
        }
    }

    /// What waits to be uploaded, or to be kept.
    pub fn arrived(&self) -> impl Iterator<Item = PayloadKey> {
        self.arrived.keys().copied()
    }

    /// Everything of which something is known.
    pub fn known(&self) -> impl Iterator<Item = PayloadKey> {
        self.empty.iter().chain(self.arrived.keys()).chain(self.copies.keys()).copied()
    }

    /// A payload that has arrived becomes a copy, as long as there is room, in the place of those that were used longest
    /// ago. `last_used`: when it was used; a copy that is there already is used `now`. Samples are made again, not kept.
    pub fn keep(&mut self, key: PayloadKey, last_used: u64, now: u64) {
        if let Some(copied) = self.copies.get_mut(&key) {
            copied.used = now;
        }
        let Some(payload) = self.arrived.remove(&key).filter(|_| key.kind != PayloadKind::Sample) else {
            return;
        };
        self.copied_bytes += payload.uploaded_bytes();
        if let Some(old) = self.copies.insert(key, Copied { payload, used: last_used }) {
            self.copied_bytes -= old.payload.uploaded_bytes();
        }
        while self.copied_bytes > self.most_copied_bytes {
            let oldest = self.copies.iter().min_by_key(|(key, copied)| (copied.used, **key));
            let Some(oldest) = oldest.map(|(key, _)| *key) else { break };
            self.drop_copy(oldest);
        }
    }

    fn drop_copy(&mut self, key: PayloadKey) {
        if let Some(copied) = self.copies.remove(&key) {
            self.copied_bytes -= copied.payload.uploaded_bytes();
        }
    }

    /// The files hold something else there by now.
    pub fn forget(&mut self, key: PayloadKey) {
        self.empty.remove(&key);
        self.damaged.remove(&key);
        self.arrived.remove(&key);
        self.drop_copy(key);
    }

    /// The same of everything of a kind.
    pub fn forget_all(&mut self, kind: PayloadKind) {
        let all: Vec<_> = self.known().filter(|key| key.kind == kind).collect();
        all.into_iter().for_each(|key| self.forget(key));
    }

    /// Whether a payload is known to hold no point.
    pub fn is_empty(&self, key: PayloadKey) -> bool {
        self.empty.contains(&key)
    }

    /// Payloads that a file's fault has touched.
    pub fn damaged(&self) -> usize {
        self.damaged.len()
    }

    /// Bytes of what has arrived.
    pub fn arrived_bytes(&self) -> u64 {
        self.arrived.values().map(|payload| payload.uploaded_bytes()).sum()
    }

    /// Bytes of copies.
    pub fn copied_bytes(&self) -> u64 {
        self.copied_bytes
    }
}
