//! The syntax of well-known text, WKT1 and WKT2 alike: `KEYWORD["text",number,KEYWORD[...]]`.
//! Source: OGC 01-009, 7; OGC 18-010r7, 7.

use std::borrow::Cow;

/// Deepest nesting read; real definitions stay under 10.
const MAX_DEPTH: usize = 32;
/// Longest text read: real definitions take about 2 kB.
pub const MAX_BYTES: usize = 1 << 20;

/// One keyword with its values.
#[derive(Debug, PartialEq)]
pub struct Node<'a> {
    /// As written.
    pub keyword: &'a str,
    /// The node from keyword to closing bracket.
    pub text: &'a str,
    /// In order.
    pub values: Vec<Value<'a>>,
}

/// A value of a [`Node`].
#[derive(Debug, PartialEq)]
pub enum Value<'a> {
    /// Quoted, quotes removed.
    Text(Cow<'a, str>),
    /// A number, or a bare word such as `EAST`.
    Word(&'a str),
    /// A node of its own.
    Node(Node<'a>),
}

/// Where and why a text is not WKT.
#[derive(Debug, PartialEq, thiserror::Error)]
#[error("byte {byte}: {reason}")]
pub struct SyntaxError {
    /// Offset in the text.
    pub byte: usize,
    /// What was expected.
    pub reason: &'static str,
}

impl<'a> Node<'a> {
    /// First text value: the name.
    pub fn name(&self) -> Option<&str> {
        match self.values.first() {
            Some(Value::Text(text)) => Some(text),
            _ => None,
        }
    }

    /// Whether the keyword is one of `keywords`, in any case.
    pub fn is(&self, keywords: &[&str]) -> bool {
        keywords.iter().any(|keyword| self.keyword.eq_ignore_ascii_case(keyword))
    }

    /// Direct children with one of `keywords`.
    pub fn children(&self, keywords: &'static [&'static str]) -> impl Iterator<Item = &Node<'a>> {
        self.values.iter().filter_map(move |value| match value {
            Value::Node(node) if node.is(keywords) => Some(node),
            _ => None,
        })
    }

    /// First direct child with one of `keywords`.
    pub fn child(&self, keywords: &'static [&'static str]) -> Option<&Node<'a>> {
        self.children(keywords).next()
    }

    /// The value at `index`, as a number whether quoted or not.
    pub fn number(&self, index: usize) -> Option<f64> {
        match self.values.get(index)? {
            Value::Text(text) => text.trim().parse().ok(),
            Value::Word(word) => word.parse().ok(),
            Value::Node(_) => None,
        }
    }
}

/// The nodes of `text`: one, or several side by side as ESRI writes a vertical system.
pub fn parse(text: &str) -> Result<Vec<Node<'_>>, SyntaxError> {
    let mut parser = Parser { text, at: 0 };
    if text.len() > MAX_BYTES {
        return Err(parser.error("longer than any definition"));
    }
    let mut roots = Vec::new();
    loop {
        let start = parser.skip_space();
        let keyword = parser.word();
        if keyword.is_empty() {
            return Err(parser.error("a keyword was expected"));
        }
        roots.push(parser.node(keyword, start, 0)?);
        parser.skip_space();
        if !parser.take(b',') {
            break;
        }
    }
    if parser.at < text.len() { Err(parser.error("text after the end")) } else { Ok(roots) }
}

struct Parser<'a> {
    text: &'a str,
    at: usize,
}

impl<'a> Parser<'a> {
    fn error(&self, reason: &'static str) -> SyntaxError {
        SyntaxError { byte: self.at, reason }
    }

    fn peek(&self) -> Option<u8> {
        self.text.as_bytes().get(self.at).copied()
    }

    fn take(&mut self, byte: u8) -> bool {
        let hit = self.peek() == Some(byte);
        self.at += usize::from(hit);
        hit
    }

    fn skip_space(&mut self) -> usize {
        while self.peek().is_some_and(|byte| byte.is_ascii_whitespace()) {
            self.at += 1;
        }
        self.at
    }

    /// Letters, digits and what numbers and words are made of; empty at anything else.
    fn word(&mut self) -> &'a str {
        let start = self.at;
        while self.peek().is_some_and(|b| b.is_ascii_alphanumeric() || b"_+-.:/".contains(&b)) {
            self.at += 1;
        }
        &self.text[start..self.at]
    }

    fn node(&mut self, keyword: &'a str, start: usize, depth: usize) -> Result<Node<'a>, SyntaxError> {
        if depth == MAX_DEPTH {
            return Err(self.error("nested too deep"));
        }
        self.skip_space();
        let close = match self.peek() {
            Some(b'[') => b']',
            Some(b'(') => b')',
            _ => return Err(self.error("[ was expected")),
        };
        self.at += 1;
        let mut values = Vec::new();
        self.skip_space();
        if !self.take(close) {
            loop {
                values.push(self.value(depth)?);
                self.skip_space();
                if self.take(close) {
                    break;
                }
                if !self.take(b',') {
                    return Err(self.error(", or ] was expected"));
                }
            }
        }
        Ok(Node { keyword, text: &self.text[start..self.at], values })
    }

    fn value(&mut self, depth: usize) -> Result<Value<'a>, SyntaxError> {
        let start = self.skip_space();
        if self.take(b'"') {
            return self.quoted();
        }
        let word = self.word();
        if word.is_empty() {
            return Err(self.error("a value was expected"));
        }
        self.skip_space();
        match self.peek() {
            Some(b'[' | b'(') => Ok(Value::Node(self.node(word, start, depth + 1)?)),
            _ => Ok(Value::Word(word)),
        }
    }

    /// After the opening quote; a doubled quote stands for one.
    fn quoted(&mut self) -> Result<Value<'a>, SyntaxError> {
        let start = self.at;
        loop {
            let Some(length) = self.text[self.at..].find('"') else {
                return Err(SyntaxError { byte: start, reason: "the quote is not closed" });
            };
            self.at += length + 1;
            if !self.take(b'"') {
                break;
            }
        }
        let text = &self.text[start..self.at - 1];
        Ok(Value::Text(if text.contains('"') { text.replace("\"\"", "\"").into() } else { text.into() }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_brackets_words_numbers_and_quotes() {
        let roots = parse(r#" A("x ""y""", -1.5e-3 ,NORTH,B[],C["ü"]) "#).unwrap();
        let [a] = &roots[..] else { panic!() };
        assert_eq!(a.name(), Some("x \"y\""));
        assert_eq!(a.number(1), Some(-0.0015));
        assert_eq!(a.values[2], Value::Word("NORTH"));
        assert_eq!(a.child(&["b"]).unwrap().values, []);
        assert_eq!(a.child(&["C"]).unwrap().text, "C[\"ü\"]");
    }

    #[test]
    fn several_roots() {
        assert_eq!(parse("A[1],B[2]").unwrap().len(), 2);
    }

    #[test]
    fn every_cut_of_a_definition_is_an_error_with_a_place() {
        let text = crs_definitions::EPSG_7405.wkt;
        assert!(parse(text).is_ok());
        for end in 0..text.len() {
            let error = parse(&text[..end]).unwrap_err();
            assert!(error.byte <= end);
        }
        assert_eq!(parse("A[1]]").unwrap_err().byte, 4);
        assert!(parse(&"A[".repeat(100_000)).is_err());
    }
}
