//! What a camera wants: the cut of the moment, what comes into sight if it goes on, and the detail that memory allows.

use super::cut::{Cut, Domain, MOST_LEVEL, Shown, Sight};
use super::motion::Motion;
use super::policy::Wanted;
use crate::coords::SectionKey;
use crate::limits::LIMITS;
use crate::section::PayloadKey;
use std::collections::{HashMap, HashSet};
use std::f64::consts::{FRAC_1_SQRT_2, SQRT_2};
use std::time::Instant;

/// In each tick: [`Demand::look`] where the view is another ([`Demand::refine_after_a_while`] before), [`Demand::look_ahead`],
/// and, once what is there has changed, [`Demand::show`]. Where what is seen does not fit: [`Demand::coarsen`], and
/// [`Demand::look`] again.
pub struct Demand {
    domain: Domain,
    sight: Option<Sight>,
    cut: Cut,
    /// Members that are seen, most urgent first.
    seen: Vec<PayloadKey>,
    /// What will be, too, if the camera goes on as it does.
    ahead: Vec<PayloadKey>,
    motion: Motion,
    started: Instant,
    shown: Vec<Shown>,
    shown_payloads: HashSet<PayloadKey>,
    shown_version: u64,
    /// How many times as many pixels as asked for a cell may cover.
    coarser: f64,
    /// Tick at which that was changed last.
    coarsened: u64,
}

impl Default for Demand {
    fn default() -> Demand {
        Demand {
            domain: Domain::default(),
            sight: None,
            cut: Cut::default(),
            seen: Vec::new(),
            ahead: Vec::new(),
            motion: Motion::default(),
            started: Instant::now(),
            shown: Vec::new(),
            shown_payloads: HashSet::new(),
            shown_version: 0,
            coarser: 1.0,
            coarsened: 0,
        }
    }
}

impl Demand {
    /// The files are others.
    pub fn set_domain(&mut self, domain: Domain) {
        self.domain = domain;
        self.sight = None;
    }

    /// Whether `sight` is not what was looked at last.
    pub fn is_other(&self, sight: &Sight) -> bool {
        self.sight.as_ref() != Some(sight)
    }

    /// Level of the coarsest sections.
    pub fn root_level(&self) -> u8 {
        self.domain.roots().first().map_or(0, |root| root.level)
    }

    /// Pixels that a cell may cover now.
    fn detail(&self, sight: &Sight) -> f64 {
        match sight.detail {
            // A quarter of a pixel is where giving up begins.
            0.0 if self.coarser > 1.0 => 0.25 * self.coarser,
            detail => detail * self.coarser,
        }
    }

    /// Another view. `sample_level`: of the sparse sample, which stands in where nothing else does.
    pub fn look(&mut self, sight: &Sight, sample_level: u8) {
        loop {
            self.cut = self.domain.cut(&Sight { detail: self.detail(sight), ..sight.clone() });
            if self.cut.nodes() < LIMITS.cut_nodes {
                break;
            }
            self.coarser *= SQRT_2;
        }
        self.sight = Some(sight.clone());
        let shown: HashMap<_, _> = self.shown.iter().copied().collect();
        let shown_level = |key: SectionKey| {
            let around = std::iter::successors(Some(key), |key| Some(key.parent()));
            let found = around.take(usize::from(MOST_LEVEL)).find_map(|key| shown.get(&key));
            found.map_or(sample_level, |from| from.section.level)
        };
        // By what is missing most on the screen: pixels of the cells that stand in.
        let mut wanted: Vec<_> = self
            .cut
            .wanted()
            .map(|(key, pixels)| (pixels * f64::from(shown_level(key)).exp2(), key))
            .collect();
        wanted.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        self.seen = wanted.into_iter().map(|(_, key)| key.into()).collect();
    }

    /// What comes into sight if the camera goes on; gives whether it was looked for.
    pub fn look_ahead(&mut self, sight: &Sight, has_moved: bool) -> bool {
        let now = self.started.elapsed().as_secs_f64();
        let by = if has_moved { self.motion.frame(sight.eye, now) } else { None };
        match by {
            Some(by) => {
                let cut = self.domain.cut(&Sight { detail: self.detail(sight), ..sight.moved(by) });
                let seen: HashSet<_> = self.seen.iter().map(|key| key.section).collect();
                let mut ahead: Vec<_> = cut.wanted().filter(|(key, _)| !seen.contains(key)).collect();
                ahead.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
                self.ahead = ahead.into_iter().map(|(key, _)| key.into()).collect();
            }
            None if has_moved || self.motion.rests(now) => self.ahead.clear(),
            None => {}
        }
        by.is_some()
    }

    /// Chooses what each place shows: see [`Cut::shown`].
    pub fn show(&mut self, live: &dyn Fn(PayloadKey) -> Option<bool>) {
        let shown = self.cut.shown(live);
        if shown != self.shown {
            self.shown_payloads = shown.iter().map(|(_, from)| *from).collect();
            (self.shown, self.shown_version) = (shown, self.shown_version + 1);
        }
    }

    /// What is wanted.
    pub fn wanted(&self) -> Wanted<'_> {
        Wanted { seen: &self.seen, ahead: &self.ahead, shown: &self.shown_payloads }
    }

    /// Each place and what it shows.
    pub fn shown(&self) -> &[Shown] {
        &self.shown
    }

    /// A number that changes whenever [`Demand::shown`] does.
    pub fn shown_version(&self) -> u64 {
        self.shown_version
    }

    /// How many times as many pixels as asked for a cell may cover, for lack of memory; 1: as asked for.
    pub fn coarser(&self) -> f64 {
        self.coarser
    }

    /// Not even what is seen fits: all of it a little coarser. Look again.
    pub fn coarsen(&mut self, tick: u64) {
        self.coarser *= SQRT_2;
        self.coarsened = tick;
    }

    /// Detail that was given up may fit another view, which is not tried in every tick. Look again.
    pub fn refine_after_a_while(&mut self, tick: u64) {
        if tick > self.coarsened + LIMITS.detail_ticks {
            self.coarser = (self.coarser * FRAC_1_SQRT_2).max(1.0);
            self.coarsened = tick;
        }
    }

    /// The detail that was asked for is tried again in the next tick.
    pub fn restore_detail(&mut self) {
        (self.coarser, self.sight) = (1.0, None);
    }
}
