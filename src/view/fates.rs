//! What became of files that were opened, in words.

use crate::load::{Fate, Fates};
use crate::source::inputs::InputError;
use crate::source::placement::Treatment;
use crate::text::harmless;
use std::path::Path;

/// A file, or what was given in the place of one, that is not shown.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refused {
    /// Its path, or the word that was given.
    pub name: String,
    /// As in the list: `left out` or `failed`.
    pub badge: &'static str,
    /// Why.
    pub why: String,
}

impl Refused {
    /// Of an input that names no file.
    pub fn input(error: &InputError) -> Refused {
        let words = error.to_string();
        let (name, why) = words.split_once(": ").unwrap_or((&words, "cannot be used"));
        Refused { name: harmless(name), badge: "failed", why: harmless(why) }
    }

    /// The last part of its path.
    pub fn short_name(&self) -> &str {
        let name = Path::new(&self.name).file_name().and_then(|name| name.to_str());
        name.unwrap_or(&self.name)
    }
}

/// Those of `fates` that are not shown.
pub fn refused(fates: &Fates) -> impl Iterator<Item = Refused> + '_ {
    fates.iter().filter_map(|(path, fate)| {
        let (badge, why) = match fate {
            Fate::Shown(_) => return None,
            Fate::LeftOut(why) => ("left out", why),
            Fate::Failed(why) => ("failed", why),
        };
        Some(Refused { name: harmless(&path.to_string_lossy()), badge, why: harmless(why) })
    })
}

/// The same where none of the files is shown after all, and why.
pub fn none_shown(fates: Fates, why: &str) -> Fates {
    let but = |fate| match fate {
        Fate::Shown(_) => Fate::LeftOut(why.to_owned()),
        refused => refused,
    };
    fates.into_iter().map(|(path, fate)| (path, but(fate))).collect()
}

/// What was done with a file's coordinates.
pub fn treatment(treatment: &Treatment) -> String {
    match treatment {
        Treatment::Placed => "placed as it is".to_owned(),
        Treatment::Assumed { world } => {
            format!(
                "names no coordinate system, and is taken to be in {world} (--assume-crs names another one)"
            )
        }
        Treatment::Unmatched { from } => {
            format!(
                "is in {from}, the files here name no coordinate system: its coordinates are taken as they are"
            )
        }
        Treatment::Transformed { from, to, how } => format!("transformed from {from} into {to} ({how})"),
        Treatment::LeftOut { why } => why.clone(),
    }
}

/// What is said once of files that were opened; `None`: that they are there says enough. `world`: the system that is drawn.
/// `is_more`: they come to others, which is told in any case.
pub fn told(fates: &Fates, refused: &[Refused], world: &str, is_more: bool) -> Option<String> {
    let shown: Vec<_> = fates
        .iter()
        .filter_map(|(path, fate)| match fate {
            Fate::Shown(treatment) => Some((path, treatment)),
            Fate::LeftOut(_) | Fate::Failed(_) => None,
        })
        .collect();
    let is_plain = refused.is_empty() && shown.iter().all(|(_, of)| **of == Treatment::Placed);
    match (&shown[..], refused) {
        ([], []) => return is_more.then(|| "All of it is open already".to_owned()),
        _ if is_plain && !is_more => return None,
        ([(path, of)], []) => {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            return Some(match of {
                Treatment::Placed => format!("{name}: added"),
                of => format!("{name}: {}", treatment(of)),
            });
        }
        ([], [only]) => return Some(format!("{}: {}: {}", only.short_name(), only.badge, only.why)),
        _ => {}
    }
    let count = |is_one: &dyn Fn(&Treatment) -> bool| shown.iter().filter(|(_, of)| is_one(of)).count();
    let of_badge = |badge: &str| refused.iter().filter(|of| of.badge == badge).count();
    let into = if world.is_empty() { String::new() } else { format!(" into {world}") };
    let taken = if world.is_empty() { String::new() } else { format!(" to be in {world}") };
    let parts = [
        (count(&|of| *of == Treatment::Placed), "placed".to_owned()),
        (count(&|of| matches!(of, Treatment::Transformed { .. })), format!("transformed{into}")),
        (count(&|of| matches!(of, Treatment::Assumed { .. })), format!("assumed{taken}")),
        (count(&|of| matches!(of, Treatment::Unmatched { .. })), "taken as they are".to_owned()),
        (of_badge("left out"), "left out".to_owned()),
        (of_badge("failed"), "failed".to_owned()),
    ];
    let parts: Vec<_> = parts.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")).collect();
    let all = shown.len() + refused.len();
    Some(format!("{all} files: {} (see Files)", parts.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    fn transformed() -> Fate {
        let [from, to, how] = ["A", "B", "on the same datum"].map(str::to_owned);
        Fate::Shown(Treatment::Transformed { from, to, how })
    }

    fn fates(of: &[Fate]) -> Fates {
        of.iter().enumerate().map(|(k, fate)| (PathBuf::from(format!("d/{k}.laz")), fate.clone())).collect()
    }

    fn say(of: &[Fate], is_more: bool) -> Option<String> {
        let fates = fates(of);
        let refused: Vec<_> = refused(&fates).collect();
        told(&fates, &refused, "B", is_more)
    }

    #[test]
    fn what_was_done_with_files_is_told_once_and_only_where_it_says_something() {
        let placed = Fate::Shown(Treatment::Placed);
        let assumed = Fate::Shown(Treatment::Assumed { world: "B".to_owned() });
        let left_out = Fate::LeftOut("too far".to_owned());
        let failed = Fate::Failed("not a LAS file".to_owned());
        assert_eq!(say(&[placed.clone(), placed.clone()], false), None);
        assert_eq!(say(std::slice::from_ref(&placed), true).unwrap(), "0.laz: added");
        assert_eq!(
            say(&[transformed()], false).unwrap(),
            "0.laz: transformed from A into B (on the same datum)"
        );
        assert_eq!(say(std::slice::from_ref(&failed), true).unwrap(), "0.laz: failed: not a LAS file");
        assert_eq!(say(&[], true).unwrap(), "All of it is open already");
        let all = [placed.clone(), placed, transformed(), assumed, left_out, failed];
        assert_eq!(
            say(&all, true).unwrap(),
            "6 files: 2 placed, 1 transformed into B, 1 assumed to be in B, 1 left out, 1 failed (see Files)"
        );
        let none: Vec<_> = refused(&none_shown(fates(&all), "too far")).map(|of| of.badge).collect();
        assert_eq!(none, ["left out", "left out", "left out", "left out", "left out", "failed"]);
    }

    #[test]
    fn an_input_that_is_none_is_named() {
        let refused = Refused::input(&InputError::Missing { path: "no/such".into() });
        assert_eq!((&*refused.name, refused.short_name()), ("no/such", "such"));
        assert_eq!((refused.badge, &*refused.why), ("failed", "no such file or folder"));
    }
}
