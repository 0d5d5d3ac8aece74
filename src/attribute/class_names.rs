//! Classes by the names that people type: `ground`, `vegetation`, `noise`.

/// Names and what they stand for: classes of LAS 1.4 R15, table 17, and groups of them. The first name of a kind is the
/// one that is listed.
const NAMES: [(&[&str], &[u8]); 31] = [
    (&["ground"], &[2]),
    (&["vegetation", "trees"], &[3, 4, 5]),
    (&["building", "roof"], &[6]),
    (&["water"], &[9, 41, 42]),
    (&["noise"], &[7, 18]),
    (&["bare earth"], &[2, 9, 10, 11, 41]),
    (&["power line", "powerline"], &[13, 14, 15, 16]),
    (&["surface"], &all_but::<254>(&[7, 18])),
    (&["all"], &all_but::<256>(&[])),
    (&["wire"], &[13, 14]),
    (&["tower", "transmission tower", "pylon"], &[15]),
    (&["bridge", "bridge deck"], &[17]),
    (&["road", "road surface"], &[11]),
    (&["rail", "railway"], &[10]),
    (&["unclassified"], &[0, 1]),
    (&["overlap"], &[12]),
    (&["low vegetation"], &[3]),
    (&["medium vegetation"], &[4]),
    (&["high vegetation"], &[5]),
    (&["low noise", "low point"], &[7]),
    (&["high noise"], &[18]),
    (&["key point", "model key point", "model keypoint", "keypoint"], &[8]),
    (&["guard wire", "wire guard", "shield wire"], &[13]),
    (&["conductor", "wire conductor", "phase wire"], &[14]),
    (&["connector", "wire structure connector", "insulator"], &[16]),
    (&["overhead structure", "overhead"], &[19]),
    (&["ignored ground"], &[20]),
    (&["snow"], &[21]),
    (&["temporal exclusion"], &[22]),
    (&["bathymetry", "bathymetric point"], &[40]),
    (&["submerged object"], &[43]),
];

/// All classes but some, of which there are `256 - LEFT`.
const fn all_but<const LEFT: usize>(left_out: &[u8]) -> [u8; LEFT] {
    let (mut left, mut at, mut class) = ([0; LEFT], 0, 0u32);
    while class < 256 {
        let (mut k, mut is_left) = (0, true);
        while k < left_out.len() {
            is_left &= left_out[k] as u32 != class;
            k += 1;
        }
        if is_left {
            left[at] = class as u8;
            at += 1;
        }
        class += 1;
    }
    assert!(at == LEFT);
    left
}

/// The classes that `name` stands for, in any case, with spaces, hyphens or underscores, singular or plural.
pub fn classes_named(name: &str) -> Option<&'static [u8]> {
    let plain: String = name.trim().to_lowercase().replace(['-', '_'], " ");
    let is = |known: &&str| plain == **known || plain.strip_suffix('s') == Some(*known);
    NAMES.iter().find(|(names, _)| names.iter().any(&is)).map(|(_, classes)| *classes)
}

/// Classes, which are in order, as `--classes` takes them: `3,4,5`, `13-16,41`.
pub fn class_numbers(classes: &[u8]) -> String {
    let runs = classes.chunk_by(|a, b| u32::from(*a) + 1 == u32::from(*b));
    let words = runs.map(|run| match run {
        [first, _, _, .., last] => format!("{first}-{last}"),
        few => few.iter().map(u8::to_string).collect::<Vec<_>>().join(","),
    });
    words.collect::<Vec<_>>().join(",")
}

/// The names that there are, with their classes: `ground (2), vegetation (3,4,5), …`.
pub fn class_names() -> String {
    let names = NAMES
        .iter()
        .map(|(names, classes)| format!("{} ({})", names[0].replace(' ', "-"), class_numbers(classes)));
    names.collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::super::{ClassMask, class_name};
    use super::*;

    #[test]
    fn names_are_found_however_they_are_written() {
        for (name, classes) in [
            ("ground", &[2][..]),
            ("Buildings", &[6]),
            ("VEGETATION", &[3, 4, 5]),
            ("low-vegetation", &[3]),
            ("High Vegetation", &[5]),
            ("noise", &[7, 18]),
            ("wires", &[13, 14]),
            ("power_lines", &[13, 14, 15, 16]),
            ("bare-earth", &[2, 9, 10, 11, 41]),
            ("water", &[9, 41, 42]),
            ("pylons", &[15]),
        ] {
            assert_eq!(classes_named(name), Some(classes), "{name}");
        }
        for name in ["", "s", "gorund", "2", "vegetation,ground"] {
            assert_eq!(classes_named(name), None, "{name}");
        }
        assert!(class_names().starts_with("ground (2), vegetation (3,4,5), building (6)"));
        assert!(
            class_names()
                .contains("power-line (13-16), surface (0-6,8-17,19-255), all (0-255), wire (13,14)")
        );
    }

    #[test]
    fn the_surface_is_what_is_shown_without_a_choice() {
        assert_eq!(ClassMask::only(classes_named("surface").unwrap()), ClassMask::default());
        assert_eq!(ClassMask::only(classes_named("all").unwrap()), ClassMask::all());
    }

    /// What a class is called in lists is understood, too.
    #[test]
    fn listed_names_are_understood() {
        for class in [2, 3, 4, 5, 6, 9, 10, 11, 15, 17, 18, 19, 20, 21, 22, 40, 43] {
            let name = class_name(class);
            assert!(classes_named(name).is_some_and(|classes| classes.contains(&class)), "{name}");
        }
    }
}
