//! Which of the points are shown: classes and flags, as they are typed.

use crate::attribute::{ClassMask, Flags, class_names, classes_named};

/// Which points are shown of those that take part.
#[derive(Clone, Debug, Default, clap::Args)]
pub(super) struct LayerArgs {
    /// Show only these classes: 2,6 or 3-5 or building,ground or bare-earth
    #[arg(long, value_parser = classes, help_heading = "Layers", value_name = "LIST")]
    classes: Option<ClassList>,
    /// Hide these classes: 3-5 or vegetation (7 and 18, noise, are hidden unless asked for)
    #[arg(long, value_parser = classes, help_heading = "Layers", value_name = "LIST")]
    hide: Option<ClassList>,
    /// Show withheld points
    #[arg(long, help_heading = "Layers")]
    withheld: bool,
    /// Hide points with any of these flags: overlap, synthetic, key-point (withheld ones are hidden unless --withheld is given;
    /// point formats 0 to 5 have no flag for overlap, but class 12: --hide 12)
    #[arg(long, value_parser = flags, help_heading = "Layers", value_name = "LIST")]
    hide_flags: Option<Flags>,
}

impl LayerArgs {
    /// Classes that are shown.
    pub(super) fn classes(&self) -> ClassMask {
        let shown = self.classes.as_ref().map_or(ClassMask::default(), |list| ClassMask::only(&list.0));
        self.hide.as_ref().map_or(shown, |list| shown.without(&list.0))
    }

    /// Flags whose points are hidden.
    pub(super) fn hidden_flags(&self) -> Flags {
        let hidden = self.hide_flags.unwrap_or_default().with(Flags::WITHHELD);
        if self.withheld { hidden.without(Flags::WITHHELD) } else { hidden }
    }
}

/// Classes, in the order in which they were typed.
#[derive(Clone, Debug, PartialEq)]
struct ClassList(Vec<u8>);

/// Numbers, ranges and names: `2,6`, `3-5`, `ground,vegetation`.
fn classes(text: &str) -> Result<ClassList, String> {
    let class = |s: &str| {
        let value: u32 = s.trim().parse().map_err(|_| format!("'{s}' is not a class"))?;
        u8::try_from(value).map_err(|_| format!("class {value} is out of range: classes are 0 to 255"))
    };
    let mut list = Vec::new();
    for part in text.split(',') {
        let is_number = part.trim().starts_with(|c: char| c.is_ascii_digit());
        match part.split_once('-').filter(|_| is_number) {
            Some((lo, hi)) => {
                let (lo, hi) = (class(lo)?, class(hi)?);
                if lo > hi {
                    return Err(format!("classes {lo}-{hi}: {lo} is above {hi}"));
                }
                list.extend(lo..=hi);
            }
            None if is_number => list.push(class(part)?),
            None => {
                let named = classes_named(part);
                list.extend(named.ok_or_else(|| {
                    format!("'{part}' is not a class: those are 0 to 255, or {}", class_names())
                })?);
            }
        }
    }
    Ok(ClassList(list))
}

/// Names of flags: `overlap,synthetic`.
fn flags(text: &str) -> Result<Flags, String> {
    let flag = |part: &str| {
        let names = || Flags::NAMED.map(|(_, name)| name).join(", ");
        let named = Flags::named(&part.trim().to_lowercase());
        named.ok_or_else(|| format!("'{part}' is not a flag: those are {}", names()))
    };
    text.split(',').try_fold(Flags::NONE, |all, part| Ok(all.with(flag(part)?)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classes_have_numbers_and_names() {
        let list = |text: &str| classes(text).map(|list| list.0);
        assert_eq!(list("2,6"), Ok(vec![2, 6]));
        assert_eq!(list("3-5, 9"), Ok(vec![3, 4, 5, 9]));
        assert_eq!(list("Building,ground,low-vegetation,64"), Ok(vec![6, 2, 3, 64]));
        assert!(
            list("gorund")
                .unwrap_err()
                .starts_with("'gorund' is not a class: those are 0 to 255, or ground (2), ")
        );
        assert!(list("2,").unwrap_err().starts_with("'' is not a class"));
        assert!(list("7-3").unwrap_err().contains("7 is above 3"));
        assert!(list("256").unwrap_err().contains("out of range"));
    }

    #[test]
    fn flags_have_names() {
        let some = Flags::OVERLAP.with(Flags::KEY_POINT);
        assert_eq!(flags("overlap, Key-Point"), Ok(some));
        assert_eq!(flags("withheld,overlap,synthetic,key-point,overlap"), Ok(Flags::ALL));
        for (wrong, part) in [("overlaps", "overlaps"), ("", ""), ("overlap,,synthetic", ""), ("8", "8")] {
            let words = format!("'{part}' is not a flag: those are withheld, overlap, synthetic, key-point");
            assert_eq!(flags(wrong), Err(words));
        }
    }

    #[test]
    fn withheld_points_are_hidden_unless_asked_for() {
        let hidden = |withheld, list: Option<&str>| {
            let hide_flags = list.map(|list| flags(list).unwrap());
            LayerArgs { withheld, hide_flags, ..LayerArgs::default() }.hidden_flags()
        };
        assert_eq!(hidden(false, None), Flags::WITHHELD);
        assert_eq!(hidden(true, None), Flags::NONE);
        assert_eq!(hidden(false, Some("overlap")), Flags::OVERLAP.with(Flags::WITHHELD));
        assert_eq!(hidden(true, Some("overlap,withheld")), Flags::OVERLAP);
    }
}
