//! What is said of each file in the list: its badge, in words, and as the table that is copied.

use super::data::FileAbout;
use super::fates::{Refused, treatment};
use crate::source::placement::Treatment;
use crate::text::harmless;
use std::fmt::Write as _;

/// How a file is marked in the list, where anything is to be said of it.
pub fn badge(file: &FileAbout) -> Option<&'static str> {
    if file.is_gone {
        return Some("gone");
    }
    if file.damage.is_some() {
        return Some("damaged");
    }
    match file.treatment {
        Treatment::Placed if file.is_far => Some("far away"),
        Treatment::Placed => None,
        Treatment::Assumed { .. } | Treatment::Unmatched { .. } => Some("assumed"),
        Treatment::Transformed { .. } => Some("transformed"),
        Treatment::LeftOut { .. } => Some("left out"),
    }
}

/// What is to be known of a file, in words.
pub fn words(file: &FileAbout) -> String {
    let mut words = harmless(&treatment(&file.treatment));
    if let Some(damage) = &file.damage {
        let _ = write!(words, "; damaged: {damage}");
    }
    if file.is_far {
        words += "; so far from the others that these are framed without it";
    }
    if file.is_gone {
        words += "; it is not where it was";
    }
    if !file.shown {
        words += "; hidden";
    }
    words
}

/// A line a file: path, state and words, with tabs between them, as tables take it.
pub fn list<'a>(files: impl Iterator<Item = &'a FileAbout>, refused: &[Refused]) -> String {
    let mut list = String::new();
    for file in files.filter(|file| !file.is_removed) {
        let path = harmless(&file.path.to_string_lossy());
        let _ = writeln!(list, "{path}\t{}\t{}", badge(file).unwrap_or("placed"), words(file));
    }
    for Refused { name, badge, why } in refused {
        let _ = writeln!(list, "{name}\t{badge}\t{why}");
    }
    list
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_that_are_not_shown_are_in_the_table() {
        let [name, why] = ["no/such", "no such file or folder"].map(str::to_owned);
        let refused = Refused { name, badge: "failed", why };
        assert_eq!(list([].into_iter(), &[refused]), "no/such\tfailed\tno such file or folder\n");
    }
}
