//! Text that comes from files, made harmless: names, citations and paths may hold anything, and what a terminal takes
//! for a command, or what turns the order of letters round, must not reach a reader as such.

/// `text` in one line, with everything that is not to be seen as it is written out: control characters (escape
/// sequences begin with one), marks that change the direction of writing, separators of lines, tags and other marks
/// without a shape. `\u{1b}[31m` stays readable as such.
pub fn harmless(text: &str) -> String {
    escaped(text, |_| false)
}

/// The same for text of several lines.
pub fn harmless_lines(text: &str) -> String {
    escaped(text, |letter| letter == '\n')
}

fn escaped(text: &str, keeps: impl Fn(char) -> bool) -> String {
    let mut harmless = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            _ if keeps(letter) || !is_hidden(letter) => harmless.push(letter),
            '\n' | '\r' | '\t' => harmless.extend(letter.escape_default()),
            _ => harmless.extend(letter.escape_unicode()),
        }
    }
    harmless
}

/// Whether a letter acts instead of being seen (Unicode 16: Cc, bidirectional controls of UAX #9, and what has no
/// shape).
fn is_hidden(letter: char) -> bool {
    letter.is_control()
        || matches!(letter,
            '\u{ad}' | '\u{61c}' | '\u{180e}'
            | '\u{200b}' | '\u{200e}' | '\u{200f}'
            | '\u{2028}'..='\u{202e}'
            | '\u{2060}'..='\u{206f}'
            | '\u{feff}' | '\u{fff9}'..='\u{fffb}'
            | '\u{e0000}'..='\u{e007f}')
}

/// A number for people: at most six digits behind the point, none of them idle; an exponent where it would be long.
pub fn tidy(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && !(1e-6..1e15).contains(&size) {
        // Four digits, again without idle ones.
        return format!("{value:.3e}")
            .parse::<f64>()
            .map_or_else(|_| value.to_string(), |v| format!("{v:e}"));
    }
    let fixed = format!("{value:.6}");
    fixed.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// Digits in groups of three: 1234567 → 1,234,567.
pub fn grouped(digits: &str) -> String {
    let groups: Vec<_> = digits.as_bytes().rchunks(3).rev().map(String::from_utf8_lossy).collect();
    groups.join(",")
}

/// To two digits, as what is estimated is told.
pub fn rounded(count: u64) -> u64 {
    let unit = 10u64.pow(count.max(1).ilog10().saturating_sub(1));
    (count + unit / 2) / unit * unit
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_shown_and_words_are_left_alone() {
        assert_eq!(harmless("Grid \x1b[31mRED\x1b]0;x\x07"), r"Grid \u{1b}[31mRED\u{1b}]0;x\u{7}");
        assert_eq!(harmless("a\nb\r\tc\u{9b}2J"), r"a\nb\r\tc\u{9b}2J");
        assert_eq!(harmless("gnp.\u{202e}zal"), r"gnp.\u{202e}zal");
        let words = "Höhe 点群 ñ № 7 \"C:\\data\" म\u{94d}\u{200d}म 𝛼";
        assert_eq!(harmless(words), words);
        assert_eq!(harmless_lines("a\n\x1bb"), "a\n\\u{1b}b");
    }

    #[test]
    fn numbers_are_tidy() {
        let numbers =
            [0.0, 1.0, -0.25, 17.275000000000002, 6_277_568.0, 100.0, 1e-6, 1e-30, 1.0 / 3e9, 1e300];
        let words =
            ["0", "1", "-0.25", "17.275", "6277568", "100", "0.000001", "1e-30", "3.333e-10", "1e300"];
        assert_eq!(numbers.map(tidy), words);
        assert_eq!(tidy(f64::NAN), "NaN");
    }
}
