//! Whether times may be compared: arithmetic alone.
//!
//! A graphics card's clock follows its load: it rises within tens of milliseconds of work, and falls between frames. The
//! same pass was seen to take 0.32 and 2.05 ms on one card. So on devices that are not CPUs the same work runs untimed
//! for [`WARM_MS`] right before what is timed ([`WarmUp`] finds how often); every piece of work is timed several times,
//! in turn with what it is compared with ([`Repeats`]); and where a piece's own times differ by more than
//! [`MOST_SPREAD`], or it was not warm, no ratio is made of them.

use crate::gpu::DeviceKind;
use crate::render::frame;
use serde::{Deserialize, Serialize};

/// Untimed work of the same kind right before what is timed, ms by the device's clock.
pub const WARM_MS: f64 = 50.0;
/// Most that the times of one piece of work may differ, of the least.
pub const MOST_SPREAD: f64 = 0.1;
/// Runs of a piece of work in one submit, at most.
const MOST_RUNS: u32 = 5000;
/// Submits that may be made to find out how often work must run to be warm.
const TRIES: u32 = 4;

/// How often a piece of work runs untimed before it is timed.
#[derive(Clone, Copy, Debug)]
pub struct WarmUp {
    runs: u32,
    needed_ms: f64,
}

impl WarmUp {
    /// Once on CPUs, whose drivers compile at the first run; elsewhere a guess to begin with.
    pub fn new(kind: DeviceKind) -> WarmUp {
        WarmUp::of(if kind == DeviceKind::Cpu { 0.0 } else { WARM_MS })
    }

    /// For work that must run for `needed_ms`; once if that is 0.
    pub fn of(needed_ms: f64) -> WarmUp {
        WarmUp { runs: if needed_ms > 0.0 { 8 } else { 1 }, needed_ms }
    }

    /// How often work runs in one submit: untimed, and timed. One timed run will do where a driver runs on the CPU: its
    /// passes are long.
    pub fn runs(&self) -> frame::PassRepeats {
        frame::PassRepeats { before: self.runs, timed: if self.needed_ms > 0.0 { TIMED } else { 1 } }
    }

    /// Most stages that a clock needs for passes of a picture.
    pub const STAGES: u32 = frame::PassRepeats { before: 1, timed: TIMED }.stages(frame::PASSES);

    /// Times a piece of work: `run` is told how often, and gives the stages of the clock (name, ns).
    pub fn time<E>(
        &mut self,
        mut run: impl FnMut(frame::PassRepeats) -> Result<Vec<(&'static str, f64)>, E>,
    ) -> Result<Timing, E> {
        let mut tries = 0;
        loop {
            tries += 1;
            let runs = self.runs();
            let mut timing = Timing::of(&run(runs)?, runs.timed);
            timing.is_warm = self.is_enough(timing.before_ms);
            if timing.is_warm || tries == TRIES {
                return Ok(timing);
            }
        }
    }

    /// Takes that those runs took `ms`, and whether that was long enough for the timed one to count; changes their number
    /// where it was not, or where it was far more than needed.
    fn is_enough(&mut self, ms: f64) -> bool {
        if self.needed_ms == 0.0 {
            return true;
        }
        let is_enough = ms >= self.needed_ms;
        if !is_enough || ms > 2.0 * self.needed_ms {
            // A quarter more, since the clock goes on rising.
            let factor = 1.25 * self.needed_ms / ms.max(1e-3);
            self.runs = (f64::from(self.runs) * factor).ceil().clamp(1.0, f64::from(MOST_RUNS)) as u32;
        }
        is_enough
    }
}

/// Timed runs of one submit, of which the middle one counts.
const TIMED: u32 = 3;

/// Times of the passes of one submit, ms.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Timing {
    /// Of the untimed runs.
    pub before_ms: f64,
    /// Those were long enough: see [`WarmUp`].
    pub is_warm: bool,
    /// Each pass: the middle one of the timed runs.
    pub passes: Vec<(&'static str, f64)>,
    /// All passes, likewise.
    pub all_ms: f64,
}

impl Timing {
    /// Of the stages (name, ns) of a submit of `timed` timed runs: see [`frame::PassRepeats`].
    pub fn of(stages: &[(&'static str, f64)], timed: u32) -> Timing {
        let (before, stages) = match stages {
            [("before", ns), rest @ ..] => (*ns, rest),
            all => (0.0, all),
        };
        let runs: Vec<_> = stages.chunks_exact((stages.len() / timed.max(1) as usize).max(1)).collect();
        let middle = |ns: Vec<f64>| median(&ns).unwrap_or(0.0) / 1e6;
        let first = runs.first().copied().unwrap_or_default();
        let passes = first.iter().enumerate();
        Timing {
            before_ms: before / 1e6,
            is_warm: false,
            passes: passes
                .map(|(k, pass)| (pass.0, middle(runs.iter().map(|run| run[k].1).collect())))
                .collect(),
            all_ms: middle(runs.iter().map(|run| run.iter().map(|stage| stage.1).sum()).collect()),
        }
    }
}

/// Times of one piece of work, taken one after the other with other work in between, ms.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Repeats {
    /// In the order in which they were taken.
    pub ms: Vec<f64>,
    /// One was taken before the device's clock had time to rise.
    pub is_cold: bool,
}

impl Repeats {
    /// Another time; `is_warm`: see [`Timing::is_warm`].
    pub fn push(&mut self, ms: f64, is_warm: bool) {
        self.ms.push(ms);
        self.is_cold |= !is_warm;
    }

    /// Of several pieces of work one after the other: the sum of the first times, of the second ones, ...
    pub fn sum<'a>(parts: impl IntoIterator<Item = &'a Repeats>) -> Repeats {
        let mut parts = parts.into_iter();
        let Some(first) = parts.next() else { return Repeats::default() };
        let mut sum = first.clone();
        for part in parts {
            sum.ms.truncate(part.ms.len());
            sum.ms.iter_mut().zip(&part.ms).for_each(|(sum, ms)| *sum += ms);
            sum.is_cold |= part.is_cold;
        }
        sum
    }

    /// The middle one, or between the two in the middle; `None` without any.
    pub fn median(&self) -> Option<f64> {
        median(&self.ms)
    }

    /// What the largest is more than the least, of the least: 0.1 for 10 %. `None` with fewer than two.
    pub fn spread(&self) -> Option<f64> {
        let least = self.ms.iter().copied().fold(f64::INFINITY, f64::min);
        let most = self.ms.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        (self.ms.len() > 1 && least > 0.0).then(|| most / least - 1.0)
    }

    /// Warm, several, and alike.
    pub fn is_steady(&self) -> bool {
        !self.is_cold && self.spread().is_some_and(|spread| spread <= MOST_SPREAD)
    }

    /// How many times as long `self` takes as `other`; `None` unless both are steady.
    pub fn ratio_to(&self, other: &Repeats) -> Option<f64> {
        let both = self.is_steady() && other.is_steady();
        self.median().zip(other.median()).filter(|_| both).map(|(own, other)| own / other)
    }
}

/// The middle one of `values`, or between the two in the middle; `None` without any.
pub fn median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let half = sorted.len() / 2;
    Some((sorted.get(half)? + sorted.get(sorted.len().checked_sub(1)? / 2)?) / 2.0)
}

/// The least of `candidates` by median, steady or not: what others are compared with. That it must be steady for a ratio
/// is asked later, so that nothing is compared with a second best.
pub fn best<'a>(candidates: impl IntoIterator<Item = &'a Repeats>) -> Option<usize> {
    let timed = candidates.into_iter().enumerate();
    let timed = timed.filter_map(|(index, repeats)| Some((index, repeats.median()?)));
    timed.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(index, _)| index)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn repeats(ms: &[f64]) -> Repeats {
        Repeats { ms: ms.to_vec(), is_cold: false }
    }

    /// A card at rest at 345 MHz that goes to 1,980 MHz within 40 ms of work, and back down while it does nothing.
    struct Card {
        mhz: f64,
    }

    impl Card {
        fn run(&mut self, cycles: f64) -> f64 {
            let ms = cycles / (self.mhz * 1e3);
            self.mhz = (self.mhz + (1980.0 - 345.0) * ms / 40.0).min(1980.0);
            ms
        }

        fn rest(&mut self, ms: f64) {
            self.mhz = (self.mhz - (1980.0 - 345.0) * ms / 40.0).max(345.0);
        }

        /// As the benchmarks time.
        fn time(&mut self, cycles: f64, warm_up: &mut WarmUp) -> Timing {
            let timing = warm_up.time(|runs| {
                let before: f64 = (0..runs.before).map(|_| self.run(cycles)).sum();
                let mut stages = vec![("before", before * 1e6)];
                stages.extend((0..runs.timed).map(|_| ("trace", self.run(cycles) * 1e6)));
                self.rest(5.0);
                Ok::<_, ()>(stages)
            });
            timing.unwrap()
        }
    }

    #[test]
    fn a_clock_that_wanders_is_waited_for() {
        // What takes 0.3 ms at the highest clock, and what takes a third of that.
        let mut card = Card { mhz: 345.0 };
        let work = [0.3, 0.1].map(|ms| ms * 1980.0 * 1e3);
        let mut warm_ups = [WarmUp::new(DeviceKind::Discrete); 2];
        let mut times = [const { Repeats { ms: Vec::new(), is_cold: false } }; 2];
        for _ in 0..5 {
            for k in 0..2 {
                let timing = card.time(work[k], &mut warm_ups[k]);
                assert!(timing.is_warm && timing.before_ms >= WARM_MS, "{timing:?}");
                times[k].push(timing.all_ms, timing.is_warm);
            }
            card.rest(25.0);
        }
        assert!(times.iter().all(Repeats::is_steady), "{times:?}");
        assert!((times[0].ratio_to(&times[1]).unwrap() - 3.0).abs() < 0.05, "{times:?}");
        // Without that, the same work gives times that are not to be compared, and are not.
        let mut card = Card { mhz: 345.0 };
        let mut cold = [const { Repeats { ms: Vec::new(), is_cold: false } }; 2];
        for round in 0..5 {
            for k in 0..2 {
                cold[k].push(card.run(work[k]), true);
                card.rest(f64::from(round % 2));
            }
        }
        assert!(!cold[0].is_steady() && cold[0].ratio_to(&cold[1]).is_none(), "{cold:?}");
    }

    #[test]
    fn a_ratio_needs_two_steady_sides() {
        let (steady, drifting) = (repeats(&[2.0, 2.1, 2.05]), repeats(&[1.0, 1.06, 1.12]));
        assert_eq!(steady.ratio_to(&repeats(&[1.0, 1.0])), Some(2.05));
        assert_eq!(steady.ratio_to(&drifting), None);
        assert_eq!(drifting.ratio_to(&steady), None);
        assert!((drifting.spread().unwrap() - 0.12).abs() < 1e-12);
        // One time says nothing of its spread.
        assert_eq!((repeats(&[1.0]).spread(), repeats(&[1.0]).is_steady()), (None, false));
        assert_eq!(steady.ratio_to(&repeats(&[])), None);
        // Nor do times that a card had no time to rise for, alike as they are.
        let mut cold = repeats(&[1.0, 1.0]);
        cold.push(1.0, false);
        assert_eq!((cold.spread(), cold.is_steady()), (Some(0.0), false));
        assert_eq!(steady.ratio_to(&cold), None);
        assert_eq!(repeats(&[0.0, 1.0]).spread(), None);
    }

    #[test]
    fn what_is_summed_is_as_steady_as_its_sum() {
        // One part in ten jumps, and the whole by 2 %.
        let parts = [repeats(&[9.0, 9.0, 9.0]), repeats(&[1.0, 1.2, 1.0])];
        let sum = Repeats::sum(&parts);
        assert!(!parts[1].is_steady() && sum.is_steady());
        assert_eq!((sum.median(), sum.ms.len()), (Some(10.0), 3));
        let mut cold = repeats(&[1.0; 3]);
        cold.is_cold = true;
        assert!(!Repeats::sum([&parts[0], &cold]).is_steady());
        assert_eq!(Repeats::sum([&parts[0], &repeats(&[1.0])]).ms, [10.0]);
        assert_eq!(Repeats::sum([]), Repeats::default());
    }

    #[test]
    fn nothing_is_compared_with_a_second_best() {
        let (slow, fast, wild) = (repeats(&[3.0, 3.0]), repeats(&[2.0, 2.1]), repeats(&[1.0, 1.5]));
        assert_eq!(best([&slow, &fast]), Some(1));
        let base = [&slow, &fast, &wild][best([&slow, &fast, &wild]).unwrap()];
        assert_eq!(base.ratio_to(&slow), None);
        assert_eq!(best([]), None);
    }

    #[test]
    fn stages_are_told_apart() {
        let stages = [
            ("before", 60e6),
            ("beams", 1e6),
            ("trace", 5e6),
            ("beams", 3e6),
            ("trace", 4e6),
            ("beams", 2e6),
            ("trace", 9e6),
        ];
        let timing = Timing::of(&stages, 3);
        assert_eq!((timing.before_ms, timing.all_ms), (60.0, 7.0));
        assert_eq!(timing.passes, [("beams", 2.0), ("trace", 5.0)]);
        assert_eq!(Timing::of(&stages[1..3], 1).passes, [("beams", 1.0), ("trace", 5.0)]);
        assert_eq!(Timing::of(&[], 1), Timing::default());
    }

    #[test]
    fn medians() {
        assert_eq!(median(&[]), None);
        assert_eq!(median(&[7.0]), Some(7.0));
        assert_eq!(median(&[3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(&[4.0, 1.0, 2.0, 3.0]), Some(2.5));
    }

    #[test]
    fn cpus_run_once_before_and_runs_stay_in_bounds() {
        let mut cpu = WarmUp::new(DeviceKind::Cpu);
        let once = frame::PassRepeats { before: 1, timed: 1 };
        assert_eq!((cpu.runs(), cpu.is_enough(0.0), cpu.runs()), (once, true, once));
        let mut card = WarmUp::new(DeviceKind::Discrete);
        assert!(!card.is_enough(0.0));
        assert_eq!(card.runs().before, MOST_RUNS);
        assert!(card.is_enough(1e4));
        assert_eq!(card.runs().before, 32);
        assert!(card.is_enough(60.0));
        assert_eq!(card.runs().before, 32);
        // What is never long enough is told.
        let cold = card.time(|_| Ok::<_, ()>(vec![("before", 1e6), ("trace", 1e6)])).unwrap();
        assert!(!cold.is_warm);
    }
}
