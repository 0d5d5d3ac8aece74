//! What is shown together: presets of classes, one class alone, all others; flags by the names of their boxes.

use crate::attribute::{ClassMask, Flags, KindCounts, class_numbers, classes_named};
use crate::resident::visibility::Visibility;

/// Classes under a name.
pub struct Preset {
    /// On its button.
    pub label: &'static str,
    /// As `--classes` takes it.
    pub name: &'static str,
}

const fn preset(label: &'static str, name: &'static str) -> Preset {
    Preset { label, name }
}

/// In the order of the panel and of the key that goes through them.
pub const PRESETS: [Preset; 5] = [
    preset("Surface", "surface"),
    preset("Bare earth", "bare-earth"),
    preset("Buildings", "building"),
    preset("Vegetation", "vegetation"),
    preset("Power lines", "power-line"),
];

impl Preset {
    fn classes(&self) -> &'static [u8] {
        classes_named(self.name).expect("presets have names of classes")
    }

    /// What it shows.
    pub fn mask(&self) -> ClassMask {
        ClassMask::only(self.classes())
    }

    /// The same in words.
    pub fn words(&self) -> String {
        match self.mask() == ClassMask::default() {
            true => "all but noise".to_owned(),
            false => format!("classes {}", class_numbers(self.classes())),
        }
    }

    /// Whether there are points that it shows, but for those that have one of `hidden` flags.
    pub fn shows_any(&self, counts: &KindCounts, hidden: Flags) -> bool {
        let shown = |class: &u8| counts.of_class(*class) > counts.flagged(*class, hidden);
        self.classes().iter().any(shown)
    }

    /// Whether `mask` shows the same of the points that there are.
    pub fn is_shown(&self, mask: &ClassMask, counts: &KindCounts) -> bool {
        let own = self.mask();
        (0..=255).all(|class| own.shows(class) == mask.shows(class) || counts.of_class(class) == 0)
    }
}

/// Each flag, and what its points are called where they are shown and hidden.
pub const FLAGS: [(Flags, &str); 4] = [
    (Flags::WITHHELD, "Withheld points"),
    (Flags::OVERLAP, "Overlap points"),
    (Flags::SYNTHETIC, "Synthetic points"),
    (Flags::KEY_POINT, "Key-points"),
];

/// The preset after the one that is shown: one that shows something, and something else.
pub fn next(shown: &Visibility, counts: &KindCounts) -> Option<&'static Preset> {
    let is_shown = |preset: &Preset| preset.is_shown(&shown.classes, counts);
    let first = PRESETS.iter().position(is_shown).map_or(0, |at| at + 1);
    let others = PRESETS.iter().cycle().skip(first).take(PRESETS.len());
    others.into_iter().find(|preset| preset.shows_any(counts, shown.hidden_flags) && !is_shown(preset))
}

/// Shows what is hidden, and hides what is shown.
pub fn inverted(mask: ClassMask) -> ClassMask {
    ClassMask(mask.0.map(|word| !word))
}

/// A class that is shown alone, and what was shown before.
#[derive(Debug, Default)]
pub struct Alone(Option<(u8, ClassMask)>);

impl Alone {
    /// Whether `mask` shows this class alone since that was asked for.
    pub fn is(&self, class: u8, mask: &ClassMask) -> bool {
        self.0.is_some_and(|(alone, _)| alone == class) && *mask == ClassMask::only(&[class])
    }

    /// Shows a class alone; one that is shown alone goes back to what was shown before.
    pub fn toggle(&mut self, class: u8, mask: &mut ClassMask) {
        let before = self.0.filter(|(alone, _)| self.is(*alone, mask)).map(|(_, before)| before);
        let only = ClassMask::only(&[class]);
        if *mask == only {
            *mask = before.unwrap_or_default();
            self.0 = None;
        } else {
            self.0 = Some((class, before.unwrap_or(*mask)));
            *mask = only;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attribute::Kind;
    use std::collections::BTreeMap;

    fn counts(of: &[Kind]) -> KindCounts {
        let of: BTreeMap<_, _> = of.iter().map(|kind| (*kind, 9)).collect();
        KindCounts { of, is_exact: true }
    }

    const NONE: Flags = Flags::NONE;

    fn label(preset: Option<&Preset>) -> &'static str {
        preset.map_or("none", |preset| preset.label)
    }

    #[test]
    fn the_key_goes_through_what_there_is() {
        let there = counts(&[(1, NONE), (2, NONE), (5, NONE), (6, Flags::WITHHELD), (7, NONE)]);
        let (classes, hidden_flags) = (ClassMask::default(), Flags::WITHHELD);
        let mut shown = Visibility { classes, hidden_flags, bridge: 4, near_ties: true };
        let mut seen = Vec::new();
        for _ in 0..4 {
            let preset = next(&shown, &there).unwrap();
            shown.classes = preset.mask();
            seen.push(preset.label);
        }
        // Buildings are withheld, wires are not there.
        assert_eq!(seen, ["Bare earth", "Vegetation", "Surface", "Bare earth"]);
        shown.hidden_flags = Flags::OVERLAP;
        assert_eq!(label(next(&shown, &there)), "Buildings");
        // From any other choice to the first.
        shown.classes = ClassMask::only(&[1, 2]);
        assert_eq!(label(next(&shown, &there)), "Surface");
        // Two that show the same are one.
        shown.classes = ClassMask::default();
        assert_eq!(label(next(&shown, &counts(&[(2, NONE)]))), "none");
        assert_eq!(label(next(&shown, &counts(&[(2, NONE), (14, NONE)]))), "Bare earth");
        assert_eq!(label(next(&shown, &counts(&[]))), "none");
    }

    #[test]
    fn presets_say_what_they_show() {
        let words = PRESETS.map(|preset| preset.words());
        let [surface, earth, buildings, vegetation, power] = words.each_ref().map(|words| &words[..]);
        assert_eq!([surface, earth], ["all but noise", "classes 2,9,10,11,41"]);
        assert_eq!([buildings, vegetation, power], ["classes 6", "classes 3,4,5", "classes 13-16"]);
        let wires = counts(&[(2, NONE), (14, NONE)]);
        assert!(PRESETS[4].is_shown(&ClassMask::only(&[14, 99]), &wires), "there is no other");
        assert!(!PRESETS[4].is_shown(&ClassMask::only(&[2, 14]), &wires));
    }

    #[test]
    fn a_class_alone_goes_back_to_what_was_before() {
        let before = ClassMask::default().without(&[5]);
        let (mut alone, mut mask) = (Alone::default(), before);
        alone.toggle(6, &mut mask);
        assert_eq!(mask, ClassMask::only(&[6]));
        // Another one alone; back is before the first.
        alone.toggle(2, &mut mask);
        assert!(mask == ClassMask::only(&[2]) && alone.is(2, &mask) && !alone.is(6, &mask));
        alone.toggle(2, &mut mask);
        assert!(mask == before && !alone.is(2, &mask));
        // What was changed since is what is gone back to.
        alone.toggle(6, &mut mask);
        mask = mask.with(&[9]);
        alone.toggle(2, &mut mask);
        alone.toggle(2, &mut mask);
        assert_eq!(mask, ClassMask::only(&[6, 9]));
        // What was shown alone from the start.
        mask = ClassMask::only(&[6]);
        Alone::default().toggle(6, &mut mask);
        assert_eq!(mask, ClassMask::default());
    }

    #[test]
    fn to_invert_twice_is_nothing() {
        let mask = ClassMask::only(&[2, 255]);
        assert_eq!(inverted(mask), ClassMask::all().without(&[2, 255]));
        assert_eq!(inverted(inverted(mask)), mask);
    }
}
