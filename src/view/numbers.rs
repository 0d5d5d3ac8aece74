//! Numbers as the window shows them.

use crate::text::{self, rounded};

/// A number in few letters: 812, 45.1 k, 12.3 M, 3.21 G.
pub fn short(n: u64) -> String {
    let scaled = |unit: f64, name: &str| {
        let value = n as f64 / unit;
        let digits = if value < 10.0 { 2 } else { usize::from(value < 100.0) };
        format!("{value:.digits$} {name}")
    };
    match n {
        0..10_000 => n.to_string(),
        10_000..1_000_000 => scaled(1e3, "k"),
        1_000_000..1_000_000_000 => scaled(1e6, "M"),
        _ => scaled(1e9, "G"),
    }
}

/// A number that is estimated: two digits, marked.
pub fn rough(n: u64) -> String {
    let rounded = rounded(n);
    let scaled = |unit: u64, name: &str| match rounded / unit {
        ones @ 0..10 => format!("~{ones}.{} {name}", rounded % unit * 10 / unit),
        many => format!("~{many} {name}"),
    };
    match rounded {
        0..1000 => format!("~{rounded}"),
        1000..1_000_000 => scaled(1000, "k"),
        1_000_000..1_000_000_000 => scaled(1_000_000, "M"),
        _ => scaled(1_000_000_000, "G"),
    }
}

/// A number with its digits in groups of three.
pub fn grouped(n: u64) -> String {
    text::grouped(&n.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        let numbers = [0, 999, 9_999, 12_345, 812_000, 1_234_567, 45_600_000, 3_210_000_000];
        let words = ["0", "999", "9999", "12.3 k", "812 k", "1.23 M", "45.6 M", "3.21 G"];
        assert_eq!(numbers.map(short), words);
    }

    #[test]
    fn estimates_look_like_none_else() {
        let numbers = [0, 1, 99, 104, 995, 1049, 24_412, 99_600, 1_960_000, 978_123_000, 3_210_000_000];
        let words =
            ["~0", "~1", "~99", "~100", "~1.0 k", "~1.0 k", "~24 k", "~100 k", "~2.0 M", "~980 M", "~3.2 G"];
        assert_eq!(numbers.map(rough), words);
        assert_eq!(
            [7, 999, 1000, 72_763, 1_234_567].map(grouped),
            ["7", "999", "1,000", "72,763", "1,234,567"]
        );
    }
}
