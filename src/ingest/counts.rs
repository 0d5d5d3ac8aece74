//! Points of each kind, counted as chunks are read: each chunk once, however often it is decoded. What was not read yet is
//! estimated from the opening sample.

use crate::attribute::{Flags, Kind, KindCounts, Kinds};
use crate::sample::SampledKinds;
use crate::source::PointBlock;
use crate::source::learned::Counts;
use std::collections::BTreeMap;

/// Kinds that points may be of.
const KINDS: usize = 256 * Flags::SETS;
/// Points that come one after the other are counted in so many places: most are alike, and additions to one place wait for
/// each other.
const LANES: usize = 4;
/// Points after which lanes of 32 bits are added up.
const MOST_IN_LANES: u64 = 1 << 30;

/// Counts points of each kind.
pub struct Histogram {
    lanes: Box<[[u32; KINDS]; LANES]>,
    in_lanes: u64,
    sums: Box<[u64; KINDS]>,
}

impl Default for Histogram {
    fn default() -> Histogram {
        Histogram { lanes: Box::new([[0; KINDS]; LANES]), in_lanes: 0, sums: Box::new([0; KINDS]) }
    }
}

/// Where a kind is counted.
fn place(class: u8, flags: u8) -> usize {
    usize::from(Flags::of(flags).bits()) << 8 | usize::from(class)
}

impl Histogram {
    /// Adds the points of a block.
    pub fn add(&mut self, block: &PointBlock) {
        self.in_lanes += block.len() as u64;
        let (classes, rest) = block.class.as_chunks::<LANES>();
        let (flags, rest_flags) = block.flags.as_chunks::<LANES>();
        for (classes, flags) in classes.iter().zip(flags) {
            for lane in 0..LANES {
                self.lanes[lane][place(classes[lane], flags[lane])] += 1;
            }
        }
        for (&class, &flags) in rest.iter().zip(rest_flags) {
            self.lanes[0][place(class, flags)] += 1;
        }
        if self.in_lanes > MOST_IN_LANES {
            self.add_up();
        }
    }

    fn add_up(&mut self) {
        for lane in self.lanes.iter_mut() {
            self.sums.iter_mut().zip(lane).for_each(|(sum, n)| *sum += u64::from(std::mem::take(n)));
        }
        self.in_lanes = 0;
    }

    /// What was counted since the last call.
    pub fn take(&mut self) -> Vec<(Kind, u64)> {
        self.add_up();
        let kind = |place: usize| ((place & 0xFF) as u8, Flags::of((place >> 8) as u8));
        let counts = self.sums.iter_mut().map(std::mem::take).enumerate();
        counts.filter(|(_, n)| *n > 0).map(|(at, n)| (kind(at), n)).collect()
    }
}

/// Points of a file.
#[derive(Default)]
pub struct FileCounts {
    counted: Counts,
    /// Records of the chunks that were not counted yet.
    left: u64,
    /// What is believed until all of it is counted.
    believed: Option<Counts>,
    /// What the opening sample has seen of it.
    sampled: SampledKinds,
    /// Seen elsewhere.
    seen: Kinds,
}

impl FileCounts {
    /// Of a file of so many records, of which that is known.
    pub fn new(records: u64, sampled: SampledKinds, kept: Counts) -> FileCounts {
        let whole = || sampled.weights.iter().map(|(kind, weight)| (*kind, weight.round() as u64)).collect();
        // Of a damaged file less was counted than there are.
        let is_sound = !kept.is_empty() && kept.values().sum::<u64>() <= records;
        let believed = if sampled.is_whole { Some(whole()) } else { is_sound.then_some(kept) };
        FileCounts { left: records, believed, sampled, ..FileCounts::default() }
    }

    /// Records of the chunks that were not counted yet.
    pub fn left(&self) -> u64 {
        self.left
    }

    /// What is exact of it, if that is known.
    fn exact(&self) -> Option<&Counts> {
        if self.left == 0 { Some(&self.counted) } else { self.believed.as_ref() }
    }

    /// What was counted of the whole file, if that is not what was believed.
    pub fn news(&self) -> Option<&Counts> {
        (self.left == 0 && self.believed.as_ref() != Some(&self.counted)).then_some(&self.counted)
    }

    /// What was believed of it is not believed any more.
    pub fn disbelieve(&mut self) {
        self.believed = None;
    }

    /// Takes in a chunk of so many records, once.
    pub fn count(&mut self, records: u64, of_chunk: Vec<(Kind, u64)>) {
        self.left = self.left.saturating_sub(records);
        for (kind, points) in of_chunk {
            *self.counted.entry(kind).or_default() += points;
        }
    }

    /// Some points of these kinds are in it.
    pub fn note(&mut self, kinds: &Kinds) {
        self.seen.extend(kinds);
    }

    /// Adds what there is, estimated where that is not known.
    fn add_to(&self, all: &mut BTreeMap<Kind, f64>) {
        let known = self.exact().unwrap_or(&self.counted);
        let mut of: BTreeMap<_, f64> = known.iter().map(|(kind, n)| (*kind, *n as f64)).collect();
        if self.exact().is_none() {
            let sampled = self.sampled.all;
            for (&kind, weight) in &self.sampled.weights {
                *of.entry(kind).or_default() += self.left as f64 * weight / sampled;
            }
            self.seen.iter().for_each(|&kind| _ = of.entry(kind).or_default());
        }
        // What was seen at all is there.
        of.into_iter().for_each(|(kind, n)| *all.entry(kind).or_default() += n.max(1.0));
    }
}

/// The points of several files.
pub fn of_all<'a>(files: impl Iterator<Item = &'a FileCounts>) -> KindCounts {
    let (mut all, mut is_exact) = (BTreeMap::new(), true);
    for file in files {
        file.add_to(&mut all);
        is_exact &= file.exact().is_some();
    }
    KindCounts { of: all.into_iter().map(|(kind, n)| (kind, n.round() as u64)).collect(), is_exact }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NONE: Flags = Flags::NONE;

    fn sampled(weights: &[(Kind, f64)], is_whole: bool) -> SampledKinds {
        let weights: BTreeMap<_, _> = weights.iter().copied().collect();
        SampledKinds { all: weights.values().sum(), weights, is_whole }
    }

    #[test]
    fn blocks_are_counted_by_class_and_flag() {
        let mut histogram = Histogram::default();
        for points in [0, 1, 3, 4, 1003] {
            let class: Vec<u8> = (0..points).map(|k| (k % 7) as u8 * 40).collect();
            // A scanner's channel is above them.
            let flags: Vec<u8> = (0..points).map(|k| 0x10 | ((k % 5) as u8 * 3)).collect();
            let mut slow = BTreeMap::new();
            for (class, flags) in class.iter().zip(&flags) {
                *slow.entry((*class, Flags::of(flags & 0xF))).or_default() += 1;
            }
            histogram.add(&PointBlock { x: vec![0; points], class, flags, ..PointBlock::default() });
            let fast: BTreeMap<_, u64> = histogram.take().into_iter().collect();
            assert_eq!(fast, slow, "{points} points");
        }
    }

    #[test]
    fn what_was_not_read_is_estimated_and_what_was_read_is_not() {
        let [ground, rare] = [(2, NONE), (15, Flags::WITHHELD.with(Flags::OVERLAP))];
        let seen = sampled(&[(ground, 30.0), ((5, NONE), 10.0)], false);
        let mut file = FileCounts::new(1000, seen.clone(), Counts::new());
        let of = |file: &FileCounts| of_all([file].into_iter());
        assert_eq!(of(&file).of, BTreeMap::from([(ground, 750), ((5, NONE), 250)]));
        assert!(!of(&file).is_exact);
        // A kind that no sample has seen.
        file.note(&Kinds::from([(18, NONE)]));
        file.count(400, vec![(ground, 390), (rare, 10)]);
        let expected = [(ground, 390 + 450), ((5, NONE), 150), (rare, 10), ((18, NONE), 1)];
        assert_eq!(of(&file).of, BTreeMap::from(expected));
        file.count(600, vec![(ground, 599), ((18, NONE), 1)]);
        let exact =
            KindCounts { of: BTreeMap::from([(ground, 989), (rare, 10), ((18, NONE), 1)]), is_exact: true };
        assert_eq!(of(&file), exact, "what the sample had seen is counted by now");
        assert_eq!([15, 2, 9].map(|class| exact.of_class(class)), [10, 989, 0]);

        let whole = FileCounts::new(40, sampled(&[(ground, 40.0)], true), Counts::new());
        let both = of_all([&whole, &file].into_iter());
        assert!(both.is_exact && both.of_class(2) == 1029);
        // Nothing is known of a file whose sample could not be read.
        let unknown = FileCounts::new(7, SampledKinds::default(), Counts::new());
        assert_eq!(of(&unknown), KindCounts::default());
        // Where some are not selected, the sample has seen fewer than there are records.
        let half = FileCounts::new(1000, SampledKinds { all: 80.0, ..seen }, Counts::new());
        assert_eq!(of(&half).of, BTreeMap::from([(ground, 375), ((5, NONE), 125)]));
    }

    #[test]
    fn what_was_counted_before_is_believed_until_it_is_counted() {
        let ground = (2, NONE);
        let new = |records: u64, kept: u64| {
            FileCounts::new(records, sampled(&[((5, NONE), 1.0)], false), [(ground, kept)].into())
        };
        let of = |file: &FileCounts| of_all([file].into_iter());
        let mut file = new(100, 100);
        assert_eq!((of(&file).of, of(&file).is_exact), ([(ground, 100)].into(), true));
        file.count(60, vec![(ground, 60)]);
        assert_eq!((of(&file).of, file.left(), file.news()), ([(ground, 100)].into(), 40, None));
        // As it was, or not.
        let mut same = new(100, 100);
        same.count(100, vec![(ground, 100)]);
        assert_eq!(same.news(), None);
        file.count(40, vec![((6, NONE), 40)]);
        assert_eq!(file.news(), Some(&[(ground, 60), ((6, NONE), 40)].into()));
        assert_eq!(of(&file).of, [(ground, 60), ((6, NONE), 40)].into());
        // More than there are, and what told lies of something else.
        assert!(!of(&new(99, 100)).is_exact);
        let mut liar = new(100, 100);
        liar.disbelieve();
        assert_eq!((of(&liar).of, of(&liar).is_exact), ([((5, NONE), 100)].into(), false));
    }
}
