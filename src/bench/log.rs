//! What a pass's threads did, counted from their logs (`shaders/log.glsl`).
//!
//! A GPU runs threads in groups of 32, in lockstep as long as they have the same to do: a group is done when its longest
//! thread is, and a load takes as many transactions as the group's threads ask for different lines of 128 bytes. Groups
//! are counted as if step k of all their threads ran together.

use crate::render::frame::{LOG_STEP, LOG_WORDS};
use serde::Serialize;

/// Threads of a lockstep group across and down, as they are counted.
pub const LOCKSTEP: [usize; 2] = [8, 4];
/// And in a row.
pub const LOCKSTEP_ROW: [usize; 2] = [32, 1];
/// Words of a log before its entries.
const HEAD: usize = 2;

/// Sums over the threads of a pass.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Threads.
    pub threads: u64,
    /// Steps of all of them.
    pub steps: u64,
    /// Most steps of one.
    pub most_steps: u64,
    /// Steps for which a lane of a group of 8 × 4 threads, or of 32 × 1, was kept: the group's longest for each.
    pub lockstep: u64,
    /// See `lockstep`.
    pub lockstep_row: u64,
    /// Loads in steps, each waiting for what was before it; those from the line of the load before, in the same step,
    /// are left out.
    pub loads: u64,
    /// Different lines that a group of 8 × 4 threads loaded from in one step, summed over groups and steps.
    pub lines: u64,
    /// Steps of all those groups.
    pub group_steps: u64,
    /// Threads whose logs were too short: their loads are not all counted.
    pub cut: u64,
}

impl Counts {
    /// Adds the logs of a stretch of rows of threads, `across` in each.
    pub fn add(&mut self, across: usize, words: &[u32]) {
        let logs: Vec<_> = words.chunks_exact(LOG_WORDS).collect();
        for log in &logs {
            let steps = u64::from(log[1]);
            self.threads += 1;
            self.steps += steps;
            self.most_steps = self.most_steps.max(steps);
            self.cut += u64::from(log[0] as usize > LOG_WORDS - HEAD);
        }
        self.lockstep += longest(across, &logs, LOCKSTEP);
        self.lockstep_row += longest(across, &logs, LOCKSTEP_ROW);
        // (step, line), of one group.
        let mut lines = Vec::new();
        groups(across, logs.len(), LOCKSTEP, |group| {
            lines.clear();
            for &thread in group {
                let log = logs[thread];
                let entries = &log[HEAD..][..(log[0] as usize).min(LOG_WORDS - HEAD)];
                let (mut step, mut last) = (0u32, None);
                for &entry in entries {
                    if entry == LOG_STEP {
                        (step, last) = (step + 1, None);
                    } else if step > 0 && last != Some(entry) {
                        last = Some(entry);
                        self.loads += 1;
                        lines.push((step, entry));
                    }
                }
            }
            lines.sort_unstable();
            lines.dedup();
            self.lines += lines.len() as u64;
            self.group_steps += group.iter().map(|&thread| u64::from(logs[thread][1])).max().unwrap_or(0);
        });
    }

    /// Steps a thread.
    pub fn steps_per_thread(&self) -> f64 {
        self.steps as f64 / self.threads as f64
    }

    /// Share of the lanes' steps in which they have something to do: groups of 8 × 4 threads, of 32 × 1.
    pub fn efficiency(&self) -> [f64; 2] {
        [self.lockstep, self.lockstep_row].map(|kept| self.steps as f64 / kept as f64)
    }

    /// Loads a step of a thread.
    pub fn loads_per_step(&self) -> f64 {
        self.loads as f64 / self.steps as f64
    }

    /// Different lines a step of a group.
    pub fn lines_per_step(&self) -> f64 {
        self.lines as f64 / self.group_steps as f64
    }
}

impl std::ops::AddAssign for Counts {
    fn add_assign(&mut self, other: Counts) {
        self.threads += other.threads;
        self.steps += other.steps;
        self.most_steps = self.most_steps.max(other.most_steps);
        self.lockstep += other.lockstep;
        self.lockstep_row += other.lockstep_row;
        self.loads += other.loads;
        self.lines += other.lines;
        self.group_steps += other.group_steps;
        self.cut += other.cut;
    }
}

/// Calls `each` with the threads of every group of `side` threads; those at the edges may have fewer.
fn groups(across: usize, threads: usize, side: [usize; 2], mut each: impl FnMut(&[usize])) {
    let down = threads / across.max(1);
    let mut group = Vec::with_capacity(side[0] * side[1]);
    for y0 in (0..down).step_by(side[1]) {
        for x0 in (0..across).step_by(side[0]) {
            group.clear();
            for y in y0..down.min(y0 + side[1]) {
                group.extend((x0..across.min(x0 + side[0])).map(|x| y * across + x));
            }
            each(&group);
        }
    }
}

/// Steps of each group's longest thread, counted for every thread of the group.
fn longest(across: usize, logs: &[&[u32]], side: [usize; 2]) -> u64 {
    let mut sum = 0;
    groups(across, logs.len(), side, |group| {
        let most = group.iter().map(|&thread| u64::from(logs[thread][1])).max().unwrap_or(0);
        sum += most * group.len() as u64;
    });
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A log of `steps`, the lines of each.
    fn log(before: &[u32], steps: &[&[u32]]) -> Vec<u32> {
        let mut entries = before.to_vec();
        for step in steps {
            entries.push(LOG_STEP);
            entries.extend_from_slice(step);
        }
        let mut log = vec![entries.len() as u32, steps.len() as u32];
        log.extend(entries);
        log.resize(LOG_WORDS, 77);
        log
    }

    #[test]
    fn steps_loads_and_lines_of_groups() {
        // Eight threads across, four down: one group of 8 × 4. The first takes three steps, the others one.
        let mut words = log(&[5], &[&[1, 1, 2], &[1], &[]]);
        for thread in 1..32 {
            words.extend(log(&[], &[&[1, 10 + thread % 2]]));
        }
        let mut counts = Counts::default();
        counts.add(8, &words);
        assert_eq!((counts.threads, counts.steps, counts.most_steps), (32, 34, 3));
        assert_eq!((counts.lockstep, counts.group_steps), (96, 3));
        // Rows of 8 threads are groups of their own among 32 × 1: only the first row waits.
        assert_eq!(counts.lockstep_row, 8 * 3 + 24);
        // What is loaded before the first step is left out, and so is a line that comes twice in a row.
        assert_eq!(counts.loads, 2 + 1 + 31 * 2);
        // Step 1: lines 1, 2, 10, 11; step 2: line 1.
        assert_eq!((counts.lines, counts.cut), (5, 0));
        assert_eq!(counts.efficiency()[0], 34.0 / 96.0);
        let mut twice = counts;
        twice += counts;
        assert_eq!((twice.steps, twice.most_steps, twice.lines), (68, 3, 10));
    }

    #[test]
    fn edges_and_logs_that_are_full() {
        // Nine across, one down: a group of eight and one of a single thread.
        let mut words: Vec<u32> = (0..8).flat_map(|_| log(&[], &[&[1]])).collect();
        words.extend(log(&[], &[&[1], &[2]]));
        let mut counts = Counts::default();
        counts.add(9, &words);
        assert_eq!((counts.lockstep, counts.lockstep_row, counts.group_steps), (10, 18, 3));
        let mut full = log(&[], &[&[1]]);
        (full[0], full[1]) = (2000, 900);
        full[HEAD..].fill(LOG_STEP);
        let mut counts = Counts::default();
        counts.add(1, &full);
        assert_eq!((counts.steps, counts.cut, counts.loads), (900, 1, 0));
    }
}
