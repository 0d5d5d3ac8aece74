//! Names of the pictures of a path: `frames/%04d.png`.

use std::path::{Path, PathBuf};

/// A file name with at most one number in it.
#[derive(Debug, PartialEq)]
pub struct Pattern {
    folder: PathBuf,
    before: String,
    /// Least digits; `None`: no number.
    digits: Option<usize>,
    after: String,
}

/// What is wrong with a pattern.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum PatternError {
    /// Neither number nor percent sign.
    #[error("'{0}' in the output's name: %d and %04d stand for the picture's number, %% for a percent sign")]
    Unknown(String),
    /// Two numbers.
    #[error("the output's name holds two numbers, {0} and {1}: one is enough")]
    Twice(String, String),
    /// Many pictures, one name.
    #[error("{count} pictures need a number in the output's name: -o 'frames/%04d.png'")]
    Missing {
        /// Pictures to be written.
        count: u32,
    },
    /// In no encoding.
    #[error("the output's name is not UTF-8")]
    Encoding,
}

impl Pattern {
    /// For `count` pictures. Folders are taken as they are.
    pub fn new(output: &Path, count: u32) -> Result<Pattern, PatternError> {
        let name = output.file_name().unwrap_or_default().to_str().ok_or(PatternError::Encoding)?;
        let mut parts = [String::new(), String::new()];
        let mut number: Option<(&str, usize)> = None;
        let mut rest = name;
        while let Some(at) = rest.find('%') {
            let behind = &rest[at + 1..];
            let digits = behind.len() - behind.trim_start_matches(|c: char| c.is_ascii_digit()).len();
            let letter = behind[digits..].chars().next();
            let end = at + 1 + digits + letter.map_or(0, char::len_utf8);
            let (said, part) = (&rest[at..end], usize::from(number.is_some()));
            parts[part].push_str(&rest[..at]);
            let width = match (&behind[..digits], letter) {
                ("", Some('%')) => None,
                ("", Some('d')) => Some(1),
                (width, Some('d')) if width.starts_with('0') => width.parse().ok().filter(|w| *w <= 20),
                _ => return Err(PatternError::Unknown(said.to_owned())),
            };
            match (width, number) {
                (Some(_), Some((first, _))) => {
                    return Err(PatternError::Twice(first.to_owned(), said.to_owned()));
                }
                (Some(width), None) => number = Some((said, width)),
                (None, _) if letter == Some('%') => parts[part].push('%'),
                (None, _) => return Err(PatternError::Unknown(said.to_owned())),
            }
            rest = &rest[end..];
        }
        parts[usize::from(number.is_some())].push_str(rest);
        if number.is_none() && count > 1 {
            return Err(PatternError::Missing { count });
        }
        let [before, after] = parts;
        let folder = output.parent().unwrap_or(Path::new("")).to_owned();
        Ok(Pattern { folder, before, digits: number.map(|(_, width)| width), after })
    }

    /// Where picture `number` goes.
    pub fn file(&self, number: u32) -> PathBuf {
        let number = self.digits.map_or(String::new(), |width| format!("{number:0width$}"));
        self.folder.join(format!("{}{number}{}", self.before, self.after))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_put_in() {
        let name = |pattern: &str, number| {
            Pattern::new(Path::new(pattern), 9).unwrap().file(number).to_str().unwrap().to_owned()
        };
        assert_eq!(name("a/%04d.png", 7), "a/0007.png");
        assert_eq!(name("%d.png", 7), "7.png");
        assert_eq!(name("%02d.png", 123), "123.png");
        assert_eq!(name("a%d/100%% %d é%%.exr", 0), "a%d/100% 0 é%.exr");
        let one = |pattern| Pattern::new(Path::new(pattern), 1).map(|p| p.file(0));
        assert_eq!(one("a.png"), Ok("a.png".into()));
        assert_eq!(one("%03d.png"), Ok("000.png".into()));
    }

    #[test]
    fn wrong_patterns_are_named() {
        let wrong = |pattern: &str| Pattern::new(Path::new(pattern), 2).unwrap_err();
        for said in ["%s", "%4d", "%-4d", "%", "%04", "%é", "%099d", "%0x", "%5%"] {
            let error = wrong(&format!("a{said}"));
            assert!(matches!(&error, PatternError::Unknown(s) if said.starts_with(s.as_str())), "{error}");
        }
        assert_eq!(wrong("%d-%02d.png"), PatternError::Twice("%d".into(), "%02d".into()));
        assert_eq!(wrong("a%%.png"), PatternError::Missing { count: 2 });
    }
}
