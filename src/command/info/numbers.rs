//! Numbers as people read them.

use crate::text::grouped;

/// 1234567 → 1,234,567.
pub(super) fn number(value: u64) -> String {
    grouped(&value.to_string())
}

pub(super) fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let (sign, text) = text.strip_prefix('-').map_or(("", text.as_str()), |rest| ("-", rest));
    // What rounds to nothing has no sign.
    let sign = if text.contains(|digit: char| ('1'..='9').contains(&digit)) { sign } else { "" };
    match text.split_once('.') {
        Some((whole, part)) => format!("{sign}{}.{part}", grouped(whole)),
        None => format!("{sign}{}", grouped(text)),
    }
}

/// Three digits that count.
pub(super) fn significant(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return "0".into();
    }
    let decimals = (2.0 - value.abs().log10().floor()).clamp(0.0, 9.0) as usize;
    fixed(value, decimals)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::text::rounded;

    #[test]
    fn numbers_read_well() {
        assert_eq!([0, 7, 99, 104, 12_345, 72_763].map(rounded), [0, 7, 99, 100, 12_000, 73_000]);
        assert_eq!(number(0), "0");
        assert_eq!(number(999), "999");
        assert_eq!(number(1_234_567), "1,234,567");
        assert_eq!(fixed(-1234.5, 2), "-1,234.50");
        assert_eq!(fixed(6_122_250.0, 0), "6,122,250");
        assert_eq!([fixed(-0.01, 0), fixed(-0.01, 2)], ["0", "-0.01"]);
        assert_eq!(
            [0.0, 0.001_234, 4.444, 16.28, 1234.5].map(significant),
            ["0", "0.00123", "4.44", "16.3", "1,234"]
        );
    }
}
