//! Checks untrusted YAML before it is parsed, so that the work is bounded by its length. The
//! parser's time grows with the square of the depth of nesting, so a text that nests deeper than
//! any valid one is refused.

/// The longest text: more than a thousand lines. What nests in a way that is not noticed below
/// costs the square of this.
pub const MAX_LEN: u64 = 128 * 1024;
/// The deepest nesting of brackets and braces, or of items and keys on one line.
const MAX_DEPTH: usize = 64;

/// Why a text is not parsed: too much for the parser.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{what} at line {line} column {column}")]
pub struct Refused {
    /// In words.
    pub what: &'static str,
    /// Counted from 1.
    pub line: usize,
    /// Counted from 1.
    pub column: usize,
}

/// Whether a text may be parsed.
///
/// # Errors
/// What is too much, with its place.
pub fn examine(text: &str) -> Result<(), Refused> {
    if text.len() as u64 > MAX_LEN {
        return Err(refused("the text is too long", 1, 1));
    }
    let mut scan = Scan::default();
    for (number, line) in (1..).zip(text.split('\n')) {
        if let Some(column) = scan.line(line) {
            return Err(refused("nested too deeply", number, column));
        }
    }
    Ok(())
}

fn refused(what: &'static str, line: usize, column: usize) -> Refused {
    Refused { what, line, column }
}

/// Follows brackets outside of quotes and comments, as an honest text has them.
#[derive(Default)]
struct Scan {
    depth: usize,
    quote: Option<char>,
}

impl Scan {
    /// The column where it is too deep.
    fn line(&mut self, line: &str) -> Option<usize> {
        let (mut before, mut indicators, mut leading) = (' ', 0, true);
        let mut chars = (1..).zip(line.chars()).peekable();
        while let Some((column, c)) = chars.next() {
            match self.quote {
                Some('"') if c == '\\' => {
                    chars.next();
                }
                Some(quote) if c == quote => self.quote = None,
                Some(_) => {}
                None => match c {
                    '#' if before.is_whitespace() => return None,
                    // Within a plain word a quote is a letter.
                    '"' | '\'' if !before.is_alphanumeric() => self.quote = Some(c),
                    '[' | '{' => self.depth += 1,
                    ']' | '}' => self.depth = self.depth.saturating_sub(1),
                    // Each of `- - - ? ? a` nests what follows.
                    '-' | '?' | ':' if leading => indicators += 1,
                    c if !c.is_whitespace() => leading = false,
                    _ => {}
                },
            }
            if self.depth.max(indicators) > MAX_DEPTH && !is_rule(line) {
                return Some(column);
            }
            before = c;
        }
        None
    }
}

/// A line of nothing but one sign, such as a rule of dashes in a text.
fn is_rule(line: &str) -> bool {
    let line = line.trim();
    !line.is_empty() && line.chars().all(|c| c == '-')
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use serde_yaml::Value;

    #[test]
    fn what_nests_too_deeply_is_refused_with_its_place() {
        for (text, at) in [
            ("{a: ".repeat(800), (1, 257)),
            ("[".repeat(800), (1, 65)),
            ("- ".repeat(800), (1, 129)),
            ("? ".repeat(800), (1, 129)),
        ] {
            let refused = examine(&text).unwrap_err();
            assert_eq!((refused.line, refused.column), at);
        }
        let error = examine(&" ".repeat(MAX_LEN as usize + 1)).unwrap_err();
        assert!(error.to_string().contains("too long"), "{error}");
    }

    #[test]
    fn honest_texts_are_parsed() {
        let flat = "- { x: 1, y: [2, 3] } # }]\n".repeat(2000);
        let words = "name: \"{[\"\nsay: don't [ care\nit: 'it''s ['\nrule: a\n";
        let dashes = format!("# {0}\ntext: |\n  {0}\n", "-".repeat(100));
        for text in [flat.as_str(), words, &dashes] {
            assert_eq!(examine(text), Ok(()));
        }
        assert!(serde_yaml::from_str::<Value>(&dashes).is_ok());
    }

    /// The worst that gets past the look: its length bounds it. The times are printed for people.
    #[test]
    fn what_hides_its_depth_ends_all_the_same() {
        for unit in ["{\"]\": ", "{'}': ", "{a\": ", "- a\n ", "&a ", "{? "] {
            let text = unit.repeat(MAX_LEN as usize / unit.len());
            let began = std::time::Instant::now();
            let read = examine(&text).is_ok() && serde_yaml::from_str::<Value>(&text).is_ok();
            eprintln!("{unit:?}: {read}, {:?}", began.elapsed());
        }
    }

    proptest! {
        #[test]
        fn no_text_makes_it_panic(text in "[-\\[\\]{}\"'#?:a \n]{0,300}") {
            let _ = examine(&text);
        }
    }
}
