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
    /// The text broke off inside it: there may be more.
    pub is_cut: bool,
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

/// The nodes of `text`: one, or several side by side as ESRI writes a vertical system. With a fault comes what was parsed
/// before it; the nodes around it end there.
pub fn parse(text: &str) -> (Vec<Node<'_>>, Option<SyntaxError>) {
    let mut parser = Parser { text, at: 0, fault: None };
    let mut roots = Vec::new();
    if text.len() > MAX_BYTES {
        parser.fail("longer than any definition");
        return (roots, parser.fault);
    }
    while parser.fault.is_none() {
        let start = parser.skip_space();
        let keyword = parser.word();
        if keyword.is_empty() {
            parser.fail("a keyword was expected");
            break;
        }
        roots.extend(parser.node(keyword, start, 0));
        parser.skip_space();
        if !parser.take(b',') {
            break;
        }
    }
    if parser.at < text.len() {
        parser.fail("text after the end");
    }
    (roots, parser.fault)
}

struct Parser<'a> {
    text: &'a str,
    at: usize,
    /// The first one: nothing is parsed behind it.
    fault: Option<SyntaxError>,
}

impl<'a> Parser<'a> {
    fn fail(&mut self, reason: &'static str) {
        let byte = self.at;
        self.fault.get_or_insert(SyntaxError { byte, reason });
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

    /// Behind the keyword; `None` where no bracket follows.
    fn node(&mut self, keyword: &'a str, start: usize, depth: usize) -> Option<Node<'a>> {
        if depth == MAX_DEPTH {
            self.fail("nested too deep");
            return None;
        }
        self.skip_space();
        let close = match self.peek() {
            Some(b'[') => b']',
            Some(b'(') => b')',
            _ => {
                self.fail("[ was expected");
                return None;
            }
        };
        self.at += 1;
        let mut values = Vec::new();
        self.skip_space();
        if !self.take(close) {
            while self.fault.is_none() {
                values.extend(self.value(depth));
                if self.fault.is_some() {
                    break;
                }
                self.skip_space();
                if self.take(close) {
                    break;
                }
                if !self.take(b',') {
                    self.fail(", or ] was expected");
                }
            }
        }
        let is_cut = self.fault.is_some();
        Some(Node { keyword, text: &self.text[start..self.at], values, is_cut })
    }

    fn value(&mut self, depth: usize) -> Option<Value<'a>> {
        let start = self.skip_space();
        if self.take(b'"') {
            return self.quoted();
        }
        let word = self.word();
        if word.is_empty() {
            self.fail("a value was expected");
            return None;
        }
        self.skip_space();
        match self.peek() {
            Some(b'[' | b'(') => self.node(word, start, depth + 1).map(Value::Node),
            // A number that breaks off may be another one.
            None => {
                self.fail(", or ] was expected");
                None
            }
            _ => Some(Value::Word(word)),
        }
    }

    /// After the opening quote; a doubled quote stands for one.
    fn quoted(&mut self) -> Option<Value<'a>> {
        let start = self.at;
        loop {
            let Some(length) = self.text[self.at..].find('"') else {
                self.at = start;
                self.fail("the quote is not closed");
                return None;
            };
            self.at += length + 1;
            if !self.take(b'"') {
                break;
            }
        }
        let text = &self.text[start..self.at - 1];
        Some(Value::Text(if text.contains('"') { text.replace("\"\"", "\"").into() } else { text.into() }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_brackets_words_numbers_and_quotes() {
        let (roots, None) = parse(r#" A("x ""y""", -1.5e-3 ,NORTH,B[],C["ü"]) "#) else { panic!() };
        let [a] = &roots[..] else { panic!() };
        assert_eq!(a.name(), Some("x \"y\""));
        assert_eq!(a.number(1), Some(-0.0015));
        assert_eq!(a.values[2], Value::Word("NORTH"));
        assert_eq!(a.child(&["b"]).unwrap().values, []);
        assert_eq!(a.child(&["C"]).unwrap().text, "C[\"ü\"]");
    }

    #[test]
    fn several_roots() {
        assert_eq!(parse("A[1],B[2]").0.len(), 2);
    }

    #[test]
    fn every_cut_of_a_definition_is_a_fault_with_a_place() {
        let text = crs_definitions::EPSG_7405.wkt;
        assert_eq!(parse(text).1, None);
        for end in 0..text.len() {
            let fault = parse(&text[..end]).1.unwrap();
            assert!(fault.byte <= end);
        }
        assert_eq!(parse("A[1]]").1.unwrap().byte, 4);
        assert!(parse(&"A[".repeat(100_000)).1.is_some());
    }

    #[test]
    fn what_stands_before_a_fault_is_there() {
        let (roots, fault) = parse(r#"A["x",B[1,C["y"]],D["z",12"#);
        assert!(fault.is_some());
        let a = &roots[0];
        assert!(a.is_cut && a.name() == Some("x"));
        assert!(!a.child(&["B"]).unwrap().is_cut);
        let d = a.child(&["D"]).unwrap();
        // 12 may have been the beginning of 123.
        assert!(d.is_cut && d.values.len() == 1);
        let (roots, fault) = parse(r#"A["x",B[1]]],C["v",U[2]]"#);
        assert_eq!((roots.len(), fault.unwrap().byte), (1, 11));
    }
}
