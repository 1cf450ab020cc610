//! Texts of the rig file as bytes, and patterns of answers.

/// Longer answers are none: a pattern with `*` would be tried at each of their characters.
const LONGEST: usize = 1000;
/// Wildcards in a pattern, at most.
const MOST_WILDCARDS: usize = 3;

/// The bytes of a text with `\r`, `\n`, `\t`, `\\` and `\x1b`; `None` where an escape is another.
pub(super) fn bytes(text: &str) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(text.len());
    let mut rest = text.chars();
    while let Some(c) = rest.next() {
        if c != '\\' {
            out.extend(c.encode_utf8(&mut [0; 4]).bytes());
            continue;
        }
        match rest.next()? {
            'r' => out.push(b'\r'),
            'n' => out.push(b'\n'),
            't' => out.push(b'\t'),
            '\\' => out.push(b'\\'),
            'x' => {
                let digit = |c: Option<char>| c.and_then(|c| c.to_digit(16));
                let (high, low) = (digit(rest.next())?, digit(rest.next())?);
                out.push(u8::try_from(high * 16 + low).ok()?);
            }
            _ => return None,
        }
    }
    Some(out)
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Token {
    Exactly(char),
    Blanks,
    Anything,
    Value,
}

/// What an answer looks like.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Pattern {
    tokens: Vec<Token>,
}

impl Pattern {
    /// Reads a pattern.
    ///
    /// # Errors
    /// What is wrong with it.
    pub(super) fn new(text: &str) -> Result<Self, String> {
        const VALUE: &str = "{value}";
        let mut tokens = Vec::new();
        let mut rest = text.trim();
        while let Some(c) = rest.chars().next() {
            if let Some(behind) = rest.strip_prefix(VALUE) {
                tokens.push(Token::Value);
                rest = behind;
                continue;
            }
            let token = match c {
                '*' => Token::Anything,
                c if c.is_whitespace() => Token::Blanks,
                c => Token::Exactly(c),
            };
            if token == Token::Exactly(c) || tokens.last() != Some(&token) {
                tokens.push(token);
            }
            rest = &rest[c.len_utf8()..];
        }
        let count = |token: Token| tokens.iter().filter(|it| **it == token).count();
        if count(Token::Value) != 1 {
            return Err(format!("{text:?} must have {VALUE} once, as T={VALUE} C"));
        }
        if count(Token::Anything) > MOST_WILDCARDS {
            return Err(format!("{text:?} has more than {MOST_WILDCARDS} of *"));
        }
        Ok(Self { tokens })
    }

    /// The number in an answer; `None` where the answer does not fit.
    pub(super) fn value(&self, answer: &str) -> Option<f64> {
        let answer = answer.trim();
        if answer.len() > LONGEST {
            return None;
        }
        find(&self.tokens, answer, None)
    }
}

fn find(tokens: &[Token], text: &str, value: Option<f64>) -> Option<f64> {
    let Some((first, tokens)) = tokens.split_first() else {
        return text.is_empty().then_some(value)?;
    };
    match first {
        Token::Exactly(c) => find(tokens, text.strip_prefix(*c)?, value),
        Token::Blanks => find(tokens, text.trim_start(), value),
        Token::Value => {
            let text = text.trim_start();
            let (number, rest) = text.split_at(number(text));
            find(tokens, rest, Some(number.parse().ok().filter(|x: &f64| x.is_finite())?))
        }
        Token::Anything => {
            let mut starts = text.char_indices().map(|(at, _)| at).chain([text.len()]);
            starts.find_map(|at| {
                // Not in the middle of a number: `*{value}` of 12.5 is not 2.5.
                let in_number = |c: char| c.is_ascii_digit() || matches!(c, '.' | '-' | '+');
                if tokens.first() == Some(&Token::Value) && text[..at].ends_with(in_number) {
                    return None;
                }
                find(tokens, &text[at..], value)
            })
        }
    }
}

/// How many characters from the start are a number: sign, digits, point, exponent.
fn number(text: &str) -> usize {
    let bytes = text.as_bytes();
    let digits = |mut at: usize| {
        while bytes.get(at).is_some_and(u8::is_ascii_digit) {
            at += 1;
        }
        at
    };
    let sign = |at: usize| at + usize::from(matches!(bytes.get(at), Some(b'+' | b'-')));
    let mut end = digits(sign(0));
    if bytes.get(end) == Some(&b'.') {
        end = digits(end + 1);
    }
    if matches!(bytes.get(end), Some(b'e' | b'E')) {
        let from = sign(end + 1);
        let exponent = digits(from);
        if exponent > from {
            end = exponent;
        }
    }
    end
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(pattern: &str, answer: &str, expected: Option<f64>) {
        assert_eq!(Pattern::new(pattern).unwrap().value(answer), expected, "{pattern} in {answer}");
    }

    #[test]
    fn escapes_are_bytes() {
        assert_eq!(bytes("T\\r\\n").unwrap(), b"T\r\n");
        assert_eq!(bytes("\\x1bA0200\\r").unwrap(), b"\x1bA0200\r");
        assert_eq!(bytes("a\\\\b\\t").unwrap(), b"a\\b\t");
        for text in ["\\q", "\\", "\\x4", "\\xgg"] {
            assert_eq!(bytes(text), None, "{text}");
        }
    }

    #[test]
    fn the_number_is_found_where_the_pattern_has_it() {
        check("{value}", "+25.250", Some(25.25));
        check("{value}", "  -1.5e-3 ", Some(-1.5e-3));
        check("T={value} C", "T=25.25 C", Some(25.25));
        check("T={value} C", "T= 25.25C", Some(25.25));
        // A Fluke 1502A and a Fluke 1521, as their manuals have it.
        check("t: {value} C *", "t:    25.587 C 12:30:01", Some(25.587));
        check("t: {value} C", "t: 25.587 C", Some(25.587));
        check("*,*,{value},*", "17, 0, 658.0123, 1.25", Some(658.0123));
        check("*{value}", "reads 12.5", Some(12.5));
        check("{value}e", "12e", Some(12.0));
    }

    #[test]
    fn what_does_not_fit_is_no_number() {
        check("{value}", "25.25 C", None);
        check("T={value} C", "T=25.25 F", None);
        check("T={value} C", "T=--- C", None);
        check("{value}", "inf", None);
        check("{value}", "", None);
        check("{value}", "-", None);
        check("{value}", "1e999", None);
        check("*{value}", &"7".repeat(2000), None);
    }

    #[test]
    fn a_pattern_without_its_value_is_refused() {
        for pattern in ["T=", "{value} {value}", "", "* * * * {value}"] {
            assert!(Pattern::new(pattern).is_err(), "{pattern}");
        }
    }
}
