//! What is uploaded, evicted and requested: from what is wanted, and how far each payload is. It knows no device: it asks
//! [`States`], and what it decides is done by [`Memory`].
//!
//! A tick calls, in this order: [`outdated`], which is evicted; [`upload`], which evicts where there is no room; and
//! [`requests`].

use super::scene::Upload;
use crate::coords::SectionKey;
use crate::section::{PayloadKey, PayloadKind};
use std::collections::{BTreeSet, HashSet};

/// What host memory has of a payload.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Host {
    /// Nothing: it has to be requested.
    #[default]
    Absent,
    /// It holds no point.
    Empty,
    /// It has been made, and not been uploaded yet.
    Arrived,
    /// It was uploaded before.
    Copied,
}

/// What the device has of a payload.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Device {
    /// Nothing.
    #[default]
    Absent,
    /// A version is on its way.
    Uploading,
    /// Tables may name it.
    Published,
    /// They may, and another version is on its way.
    Replacing,
}

/// How far a payload is.
///
/// ```text
/// Absent ── request ──▶ Arrived ── upload ──▶ Copied, Uploading ──▶ Copied, Published ── evict ──▶ Copied or Absent
///        └────────────▶ Empty
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SectionState {
    /// What host memory has.
    pub host: Host,
    /// What the device has.
    pub device: Device,
    /// What the device has is of the files as they were.
    pub is_stale: bool,
    /// When it was wanted or shown last.
    pub last_used: u64,
}

impl SectionState {
    fn is_uploading(self) -> bool {
        matches!(self.device, Device::Uploading | Device::Replacing)
    }

    /// Whether nothing has to be done for it: it is on the device, of the files as they are, or there is nothing of it.
    pub fn is_there(self) -> bool {
        self.host == Host::Empty || self.device == Device::Published && !self.is_stale
    }

    fn has_payload(self) -> bool {
        matches!(self.host, Host::Arrived | Host::Copied)
    }

    /// Whether there is something to be uploaded that the device lacks.
    fn is_due(self) -> bool {
        self.has_payload()
            && (self.device == Device::Absent || self.device == Device::Published && self.is_stale)
    }
}

/// What is asked of every payload.
pub trait States {
    /// How far it is.
    fn state(&self, key: PayloadKey) -> SectionState;
    /// Bytes that are uploaded of a payload in host memory, and those that it takes on the device.
    fn bytes(&self, key: PayloadKey) -> [u64; 2];
    /// Bytes that it takes on the device now.
    fn resident_bytes(&self, key: PayloadKey) -> u64;
    /// What the device has anything of.
    fn resident(&self) -> Vec<PayloadKey>;
    /// What has arrived in host memory and was not uploaded.
    fn arrived(&self) -> Vec<PayloadKey>;
}

/// What uploads and evicts.
pub trait Memory: States {
    /// What can go wrong.
    type Error;
    /// Starts to upload a payload from host memory, where only a copy stays.
    fn try_upload(&mut self, key: PayloadKey) -> Result<Upload, Self::Error>;
    /// Takes payloads off the device.
    fn evict(&mut self, keys: &[PayloadKey]) -> Result<(), Self::Error>;
    /// What has arrived becomes a copy that may be given up.
    fn keep(&mut self, key: PayloadKey);
}

/// What is wanted on the device.
#[derive(Clone, Copy, Debug)]
pub struct Wanted<'a> {
    /// Is seen, most urgent first.
    pub seen: &'a [PayloadKey],
    /// Will be, if the camera goes on.
    pub ahead: &'a [PayloadKey],
    /// Is shown at present, in its own place or as a stand-in.
    pub shown: &'a HashSet<PayloadKey>,
}

/// What came of [`upload`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Uploaded {
    /// Bytes whose upload was started.
    pub bytes: u64,
    /// What is seen does not fit, and nothing could be evicted for it.
    pub is_full: bool,
}

/// Starts uploads, in this order: stand-ins that have arrived, what is seen, what will be; up to the first after
/// `most_bytes` (`None`: nothing is uploaded). Where the device is full, what is not wanted is evicted, and uploads go on in a later call: the device may
/// still be reading it.
pub fn upload<M: Memory>(
    wanted: Wanted,
    memory: &mut M,
    most_bytes: Option<u64>,
) -> Result<Uploaded, M::Error> {
    let mut uploaded = Uploaded::default();
    let mut has_room_ahead = true;
    let stand_ins = memory.arrived().into_iter().filter(|key| key.kind == PayloadKind::Sample);
    let mut order: Vec<_> = stand_ins.collect::<BTreeSet<_>>().into_iter().collect();
    let first_seen = order.len();
    order.extend(wanted.seen.iter().filter(|key| memory.state(**key).has_payload()));
    let first_ahead = order.len();
    order.extend(wanted.ahead.iter().filter(|key| memory.state(**key).has_payload()));
    for (k, &key) in order.iter().enumerate() {
        // One that was kept may have made room for one that has arrived since.
        if !memory.state(key).is_due() {
            continue;
        }
        let Some(bytes_left) = most_bytes.and_then(|most| most.checked_sub(uploaded.bytes)) else { break };
        let [bytes, _] = memory.bytes(key);
        match memory.try_upload(key)? {
            Upload::Started => uploaded.bytes += bytes,
            Upload::Later => break,
            // A stand-in is not worth the detail of what it stands in for.
            Upload::Full if k < first_seen => {}
            // What is not seen yet is not worth what is.
            Upload::Full => {
                let is_ahead = k >= first_ahead;
                let rest = if is_ahead { &order[k..] } else { &order[k..first_ahead] };
                let needed = needed_bytes(memory, rest, bytes_left);
                let evicted = evictions(wanted, memory, needed, is_ahead);
                memory.evict(&evicted)?;
                has_room_ahead = !is_ahead || !evicted.is_empty();
                uploaded.is_full = !is_ahead && evicted.is_empty();
                break;
            }
        }
    }
    keep_the_rest(wanted, memory, has_room_ahead);
    Ok(uploaded)
}

/// What has arrived and need not be uploaded is worth keeping: what is not wanted any more, and what was made twice.
fn keep_the_rest<M: Memory>(wanted: Wanted, memory: &mut M, has_room_ahead: bool) {
    let arrived = memory.arrived();
    if arrived.is_empty() {
        return;
    }
    let ahead = if has_room_ahead { wanted.ahead } else { &[] };
    let wanted: HashSet<_> = wanted.seen.iter().chain(ahead).collect();
    for key in arrived {
        let is_wanted = key.kind == PayloadKind::Sample || wanted.contains(&key);
        let state = memory.state(key);
        if !is_wanted || !state.is_due() && !state.is_uploading() {
            memory.keep(key);
        }
    }
}

/// Bytes on the device of what is to be uploaded of `order`, about `most_bytes` at a time.
fn needed_bytes(states: &impl States, order: &[PayloadKey], most_bytes: u64) -> u64 {
    let (mut uploaded, mut held) = (0, 0);
    for &key in order.iter().filter(|key| states.state(**key).is_due()) {
        if uploaded > most_bytes {
            break;
        }
        let [bytes, on_device] = states.bytes(key);
        uploaded += bytes;
        held += on_device;
    }
    held
}

/// What is evicted so that `bytes` are free: what is not wanted, what was used longest ago first and stand-ins last; for
/// what is not seen yet, what is seen or will be stays.
fn evictions(wanted: Wanted, states: &impl States, bytes: u64, for_ahead: bool) -> Vec<PayloadKey> {
    let mut stays: HashSet<_> = wanted.seen.iter().copied().collect();
    if for_ahead {
        stays.extend(wanted.ahead.iter().chain(wanted.shown));
    }
    let spare = states.resident().into_iter();
    let spare = spare.filter(|key| !stays.contains(key) && key.kind != PayloadKind::Sample);
    // What stands in for something goes last.
    let mut spare: Vec<_> =
        spare.map(|key| (wanted.shown.contains(&key), states.state(key).last_used, key)).collect();
    spare.sort_unstable();
    let mut room = 0;
    let enough = |&(_, _, key): &(bool, u64, PayloadKey)| {
        let goes = room < bytes;
        room += states.resident_bytes(key);
        goes
    };
    spare.into_iter().take_while(enough).map(|(_, _, key)| key).collect()
}

/// What the device must not have any longer: what has become empty, what is coarser than the roots (`root_level`), which
/// nothing wants, and what is not of the present sparse sample, of which `sample` says the level and, once all of it has
/// arrived, the sections.
pub fn outdated(
    states: &impl States,
    candidates: impl IntoIterator<Item = PayloadKey>,
    root_level: u8,
    (level, sample): (u8, Option<&HashSet<SectionKey>>),
) -> Vec<PayloadKey> {
    let is_outdated = |key: &PayloadKey| match key.kind {
        PayloadKind::Columns => {
            let state = states.state(*key);
            key.section.level > root_level || state.is_stale && state.host == Host::Empty
        }
        PayloadKind::Sample => {
            key.section.level != level || sample.is_some_and(|sample| !sample.contains(&key.section))
        }
    };
    candidates.into_iter().filter(is_outdated).collect()
}

/// What is seen and is not there.
pub fn missing<'a>(wanted: Wanted<'a>, states: &'a impl States) -> impl Iterator<Item = PayloadKey> + 'a {
    wanted.seen.iter().copied().filter(|&key| !states.state(key).is_there())
}

/// What is to be made, most urgent first: what is wanted and neither there, nor in host memory, nor on its way.
pub fn requests(wanted: Wanted, states: &impl States) -> Vec<PayloadKey> {
    let lacks = |key: &PayloadKey| {
        let state = states.state(*key);
        !state.is_there() && !state.has_payload() && !state.is_uploading()
    };
    wanted.seen.iter().chain(wanted.ahead).copied().filter(lacks).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::resident::host_cache::HostCache;
    use crate::section::{Columns, Payload};
    use proptest::prelude::*;
    use std::collections::HashMap;
    use std::sync::Arc;

    fn key(k: u8) -> PayloadKey {
        PayloadKey::columns(SectionKey { level: 0, i: k.into(), j: 0 })
    }

    fn sample(k: u8) -> PayloadKey {
        PayloadKey::sample(SectionKey { level: 9, i: k.into(), j: 0 })
    }

    /// A payload that says it takes so many words, of which none is looked at.
    fn payload(words: u32) -> Arc<Payload> {
        let mut payload = Columns::default().pack();
        payload.layout.words = words;
        Arc::new(payload)
    }

    /// A device of `budget` bytes: what is evicted is free after the next step, what is uploaded published.
    struct Model {
        cache: HostCache,
        /// What the device has, and the bytes of it.
        device: HashMap<PayloadKey, (Device, u64)>,
        stale: HashSet<PayloadKey>,
        used: HashMap<PayloadKey, u64>,
        retired: u64,
        budget: u64,
        now: u64,
        /// The next upload finds no room in the ring.
        ring_is_full: bool,
        uploads: Vec<PayloadKey>,
        evicted: Vec<PayloadKey>,
    }

    impl Model {
        fn new(budget: u64, most_copied: u64) -> Model {
            Model {
                cache: HostCache::new(most_copied),
                device: HashMap::new(),
                stale: HashSet::new(),
                used: HashMap::new(),
                retired: 0,
                budget,
                now: 0,
                ring_is_full: false,
                uploads: Vec::new(),
                evicted: Vec::new(),
            }
        }

        /// One that holds the first `n` keys, of 50,000 words each, and no more.
        fn full(n: u8) -> Model {
            let mut model = Model::new(payload(50_000).device_bytes() * u64::from(n), 1 << 30);
            let seen: Vec<_> = (0..n).map(key).collect();
            seen.iter().for_each(|&key| model.arrive(key, 50_000));
            let shown = HashSet::new();
            upload(Wanted { seen: &seen, ahead: &[], shown: &shown }, &mut model, Some(u64::MAX)).unwrap();
            model.step();
            model
        }

        fn held(&self) -> u64 {
            self.device.values().map(|(_, bytes)| bytes).sum::<u64>() + self.retired
        }

        /// The device is done with everything.
        fn step(&mut self) {
            self.step_some(u32::MAX);
        }

        /// The device is done with the sections whose bit is set; with what was evicted if any is.
        fn step_some(&mut self, done: u32) {
            self.now += 1;
            if done != 0 {
                self.retired = 0;
            }
            for (key, (device, _)) in &mut self.device {
                if done >> (key.section.i & 31) & 1 != 0 {
                    *device = Device::Published;
                }
            }
        }

        fn arrive(&mut self, key: PayloadKey, words: u32) {
            if key.kind == PayloadKind::Sample {
                self.stale.insert(key);
            }
            self.cache.insert(key, (words > 0).then(|| payload(words)), false);
        }

        /// What holds after every call.
        fn check(&self, wanted: Wanted) {
            assert!(self.held() <= self.budget, "{} of {}", self.held(), self.budget);
            for key in &self.evicted {
                assert!(!wanted.seen.contains(key), "{key:?} is seen, and was evicted");
            }
            // In order: what is seen comes before what will be.
            let rank = |key: &PayloadKey| match key.kind {
                PayloadKind::Sample => 0,
                _ if wanted.seen.contains(key) => 1,
                _ => 2,
            };
            assert!(self.uploads.is_sorted_by_key(rank), "{:?}", self.uploads);
            let place = |key: &PayloadKey| wanted.seen.iter().position(|seen| seen == key);
            assert!(self.uploads.iter().filter_map(place).is_sorted());
        }
    }

    impl States for Model {
        fn state(&self, key: PayloadKey) -> SectionState {
            SectionState {
                host: self.cache.host(key),
                device: self.device.get(&key).map_or(Device::Absent, |(device, _)| *device),
                is_stale: self.stale.contains(&key),
                last_used: self.used.get(&key).copied().unwrap_or(0),
            }
        }

        fn bytes(&self, key: PayloadKey) -> [u64; 2] {
            self.cache.get(key).map_or([0; 2], |p| [p.uploaded_bytes(), p.device_bytes()])
        }

        fn resident_bytes(&self, key: PayloadKey) -> u64 {
            self.device.get(&key).map_or(0, |(_, bytes)| *bytes)
        }

        fn resident(&self) -> Vec<PayloadKey> {
            self.device.keys().copied().collect()
        }

        fn arrived(&self) -> Vec<PayloadKey> {
            self.cache.arrived().collect()
        }
    }

    impl Memory for Model {
        type Error = std::convert::Infallible;

        fn try_upload(&mut self, key: PayloadKey) -> Result<Upload, Self::Error> {
            // Nothing is uploaded twice: neither while it is on its way, nor where the device has it as it is.
            let state = self.state(key);
            assert!(!state.is_uploading(), "{key:?} {state:?}");
            assert!(state.device == Device::Absent || state.is_stale, "{key:?} {state:?}");
            let [_, bytes] = self.bytes(key);
            if std::mem::take(&mut self.ring_is_full) {
                return Ok(Upload::Later);
            }
            if self.held() + bytes > self.budget {
                return Ok(if self.retired > 0 { Upload::Later } else { Upload::Full });
            }
            // The version that is published goes when this one is.
            let (device, before) = match self.device.get(&key) {
                Some(&(_, before)) => (Device::Replacing, before),
                None => (Device::Uploading, 0),
            };
            self.retired += before;
            self.device.insert(key, (device, bytes));
            self.stale.remove(&key);
            self.uploads.push(key);
            self.keep(key);
            Ok(Upload::Started)
        }

        fn evict(&mut self, keys: &[PayloadKey]) -> Result<(), Self::Error> {
            for key in keys {
                let (_, bytes) = self.device.remove(key).expect("it is on the device");
                self.retired += bytes;
                self.stale.remove(key);
                self.evicted.push(*key);
            }
            Ok(())
        }

        fn keep(&mut self, key: PayloadKey) {
            let last_used = self.used.get(&key).copied().unwrap_or(0);
            self.cache.keep(key, last_used, self.now);
        }
    }

    /// One tick of a camera, after what has arrived in between.
    #[derive(Clone, Debug)]
    struct View {
        seen: Vec<u8>,
        ahead: Vec<u8>,
        arrivals: Vec<(u8, u32)>,
        samples: Vec<(u8, u32)>,
        changed: Vec<u8>,
        most_bytes: u64,
        /// Sections that the device is done with.
        done: u32,
        ring_is_full: bool,
    }

    fn view() -> impl Strategy<Value = View> {
        let keys = || prop::collection::hash_set(0u8..24, 0..12).prop_map(|set| set.into_iter().collect());
        let arrivals = prop::collection::vec((0u8..24, 0u32..200_000), 0..8);
        let samples = prop::collection::vec((0u8..4, 1u32..9000), 0..2);
        let device = (0u64..3_000_000, any::<u32>(), prop::bool::weighted(0.2));
        (keys(), keys(), arrivals, samples, keys(), device).prop_map(
            |(seen, ahead, arrivals, samples, mut changed, device): (Vec<u8>, Vec<u8>, _, _, Vec<u8>, _)| {
                let (most_bytes, done, ring_is_full) = device;
                changed.truncate(2);
                let ahead = ahead.into_iter().filter(|key| !seen.contains(key)).collect();
                View { seen, ahead, arrivals, samples, changed, most_bytes, done, ring_is_full }
            },
        )
    }

    proptest! {
        /// Budgets hold; what is wanted comes first and in order; nothing is evicted that is seen; nothing is uploaded
        /// twice; what is requested is what is missing, and nothing else.
        #[test]
        fn any_flight_keeps_to_the_rules(
            views in prop::collection::vec(view(), 1..30),
            budget in 4u64..40,
            most_copied in 0u64..4_000_000,
        ) {
            let mut model = Model::new(budget << 20, most_copied);
            for view in views {
                model.step_some(view.done);
                model.ring_is_full = view.ring_is_full;
                let (seen, ahead): (Vec<_>, Vec<_>) =
                    (view.seen.iter().map(|&k| key(k)).collect(), view.ahead.iter().map(|&k| key(k)).collect());
                for &k in &view.changed {
                    model.cache.forget(key(k));
                    if model.device.contains_key(&key(k)) {
                        model.stale.insert(key(k));
                    }
                }
                view.arrivals.iter().for_each(|&(k, words)| {
                    // As feeds do, a section comes anew only where the files have changed.
                    if model.cache.host(key(k)) == Host::Absent {
                        model.arrive(key(k), words);
                    }
                });
                view.samples.iter().for_each(|&(k, words)| model.arrive(sample(k), words));
                let shown: HashSet<_> = model.device.keys().copied().take(5).collect();
                let wanted = Wanted { seen: &seen, ahead: &ahead, shown: &shown };
                model.used.extend(seen.iter().chain(&ahead).map(|&key| (key, model.now)));
                (model.uploads, model.evicted) = (Vec::new(), Vec::new());
                let gone = outdated(&model, model.resident(), 8, (9, None));
                for key in model.resident() {
                    prop_assert_eq!(gone.contains(&key), model.cache.is_empty(key) && model.stale.contains(&key));
                }
                model.evict(&gone).unwrap();
                model.evicted.clear();
                let sizes: HashMap<_, _> =
                    (0..24).map(key).chain((0..4).map(sample)).map(|key| (key, model.bytes(key)[0])).collect();
                let uploaded = upload(wanted, &mut model, Some(view.most_bytes)).unwrap();
                model.check(wanted);
                prop_assert!(model.cache.copied_bytes() <= most_copied);
                // The last upload may go over what a frame may, no other.
                let last = model.uploads.last().map_or(0, |key| sizes[key]);
                prop_assert!(uploaded.bytes.saturating_sub(last) <= view.most_bytes);
                prop_assert_eq!(uploaded.bytes, model.uploads.iter().map(|key| sizes[key]).sum::<u64>());
                // Full is what holds nothing but what is seen, and samples.
                let is_spare = |key: &PayloadKey| key.kind == PayloadKind::Columns && !seen.contains(key);
                prop_assert!(!uploaded.is_full || !model.device.keys().any(is_spare));
                // What has arrived waits only where it is wanted.
                for key in model.arrived() {
                    let waits = key.kind == PayloadKind::Sample || seen.contains(&key) || ahead.contains(&key);
                    prop_assert!(waits, "{:?}", key);
                }
                let requested = requests(wanted, &model);
                for key in seen.iter().chain(&ahead) {
                    let state = model.state(*key);
                    let has = state.is_there() || state.has_payload() || state.is_uploading();
                    prop_assert_eq!(requested.contains(key), !has, "{:?} {:?}", key, state);
                }
                let place = |key: &PayloadKey| seen.iter().chain(&ahead).position(|wanted| wanted == key);
                prop_assert!(requested.iter().map(place).is_sorted());
            }
        }

        /// A camera that rests gets all that it sees, whatever is on the device, if that fits.
        #[test]
        fn what_is_seen_comes_in_the_end(
            sizes in prop::collection::vec(1000u32..100_000, 12),
            others in prop::collection::vec(1000u32..100_000, 0..12),
            most_bytes in 0u64..1_000_000,
        ) {
            let seen: Vec<_> = (0..12).map(key).collect();
            let needed: u64 = sizes.iter().map(|&words| payload(words).device_bytes()).sum();
            let mut model = Model::new(needed, 1 << 40);
            // Others were seen before, and fill the device.
            let before: Vec<_> = (12..12 + others.len() as u8).map(key).collect();
            before.iter().zip(&others).for_each(|(&key, &words)| model.arrive(key, words));
            let none = HashSet::new();
            for _ in 0..20 {
                model.step();
                let wanted = Wanted { seen: &before, ahead: &[], shown: &none };
                upload(wanted, &mut model, Some(u64::MAX)).unwrap();
            }
            seen.iter().zip(&sizes).for_each(|(&key, &words)| model.arrive(key, words));
            let wanted = Wanted { seen: &seen, ahead: &[], shown: &none };
            for _ in 0..60 {
                model.step();
                prop_assert!(!upload(wanted, &mut model, Some(most_bytes)).unwrap().is_full);
            }
            model.step();
            prop_assert_eq!(missing(wanted, &model).count(), 0);
            prop_assert!(requests(wanted, &model).is_empty());
        }
    }

    #[test]
    fn what_is_not_seen_makes_no_room_in_what_is() {
        let mut model = Model::new(payload(50_000).device_bytes() * 2, 1 << 30);
        let (seen, ahead) = ([key(0), key(1)], [key(2)]);
        for k in 0..3 {
            model.arrive(key(k), 50_000);
        }
        let shown = HashSet::new();
        let wanted = Wanted { seen: &seen, ahead: &ahead, shown: &shown };
        for _ in 0..3 {
            upload(wanted, &mut model, Some(u64::MAX)).unwrap();
            model.step();
        }
        assert_eq!(model.uploads, seen);
        assert!(model.evicted.is_empty());
        // What will be seen waits in host memory as a copy that may go.
        assert_eq!(model.cache.host(key(2)), Host::Copied);
        // A third that is seen finds no room: nothing can go for it.
        let seen = [key(0), key(1), key(2)];
        let wanted = Wanted { seen: &seen, ahead: &[], shown: &shown };
        assert!(upload(wanted, &mut model, Some(u64::MAX)).unwrap().is_full);
        assert!(upload(wanted, &mut model, None).unwrap() == Uploaded::default());
    }

    #[test]
    fn a_stand_in_that_does_not_fit_blocks_nothing() {
        let mut model = Model::new(payload(50_000).device_bytes(), 1 << 30);
        model.arrive(sample(0), 900_000);
        model.arrive(key(0), 50_000);
        let (seen, shown) = ([key(0)], HashSet::new());
        upload(Wanted { seen: &seen, ahead: &[], shown: &shown }, &mut model, Some(u64::MAX)).unwrap();
        assert_eq!(model.uploads, seen);
    }

    #[test]
    fn stand_ins_are_evicted_last() {
        let mut model = Model::full(2);
        // The one that was used longest ago stands in for something.
        model.used = HashMap::from([(key(0), 1), (key(1), 2)]);
        let shown = HashSet::from([key(0)]);
        model.arrive(key(2), 50_000);
        let seen = [key(2)];
        upload(Wanted { seen: &seen, ahead: &[], shown: &shown }, &mut model, Some(u64::MAX)).unwrap();
        assert_eq!(model.evicted, [key(1)]);
    }

    #[test]
    fn what_was_used_longest_ago_is_evicted_first() {
        let mut model = Model::full(3);
        model.used = HashMap::from([(key(0), 2), (key(1), 1), (key(2), 3)]);
        model.arrive(key(3), 50_000);
        let none = HashSet::new();
        upload(Wanted { seen: &[key(3)], ahead: &[], shown: &none }, &mut model, Some(u64::MAX)).unwrap();
        assert_eq!(model.evicted, [key(1)]);
    }

    #[test]
    fn what_will_be_seen_takes_nothing_from_what_is_shown() {
        let mut model = Model::full(3);
        // One is shown as a stand-in, one will be seen as well: the third goes.
        model.arrive(key(3), 50_000);
        let shown = HashSet::from([key(0)]);
        let wanted = Wanted { seen: &[], ahead: &[key(3), key(1)], shown: &shown };
        upload(wanted, &mut model, Some(u64::MAX)).unwrap();
        assert_eq!(model.evicted, [key(2)]);
    }

    #[test]
    fn uploads_end_with_the_first_that_reaches_what_a_frame_may() {
        let mut model = Model::new(1 << 40, 1 << 30);
        let seen: Vec<_> = (0..4).map(key).collect();
        seen.iter().for_each(|&key| model.arrive(key, 1000));
        let none = HashSet::new();
        let wanted = Wanted { seen: &seen, ahead: &[], shown: &none };
        // Up to the first after so many bytes.
        upload(wanted, &mut model, Some(4000)).unwrap();
        assert_eq!(model.uploads.len(), 2);
        model.step();
        upload(wanted, &mut model, Some(0)).unwrap();
        assert_eq!(model.uploads.len(), 3);
    }

    #[test]
    fn samples_of_other_files_go_once_the_new_one_is_there() {
        let mut model = Model::new(1 << 30, 0);
        let other_level = PayloadKey::sample(SectionKey { level: 10, i: 0, j: 0 });
        let above_roots = PayloadKey::columns(SectionKey { level: 9, i: 0, j: 0 });
        for key in [sample(0), sample(1), other_level, key(0), above_roots] {
            model.device.insert(key, (Device::Published, 1));
        }
        let now = HashSet::from([sample(0).section]);
        let mut gone = outdated(&model, model.resident(), 8, (9, None));
        gone.sort();
        assert_eq!(gone, [above_roots, other_level]);
        gone = outdated(&model, model.resident(), 8, (9, Some(&now)));
        gone.sort();
        assert_eq!(gone, [above_roots, sample(1), other_level]);
        // What has become empty.
        model.stale.insert(key(0));
        model.cache.insert(key(0), None, false);
        assert!(outdated(&model, model.resident(), 9, (9, Some(&now))).contains(&key(0)));
    }
}
