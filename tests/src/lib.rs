//! What the tests that cross rooms share: the workspace's own files, read as text. The sessions end
//! to end are tests of `crates/app`, where Cargo gives them the program.

#![expect(clippy::unwrap_used, reason = "helpers of tests stop the test")]

use std::path::{Path, PathBuf};

/// A file of the workspace.
#[derive(Debug, Clone)]
pub struct Source {
    /// From the workspace's root, with `/` between folders.
    pub path: String,
    /// What it holds.
    pub text: String,
}

/// The workspace's root.
#[must_use]
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_path_buf()
}

/// Every file whose name ends in one of `endings`, sorted by path. What is hidden or built is no
/// part of the workspace.
#[must_use]
pub fn files(endings: &[&str]) -> Vec<Source> {
    let mut found = Vec::new();
    gather(&root(), "", endings, &mut found);
    found.sort_by(|a, b| a.path.cmp(&b.path));
    assert!(!found.is_empty());
    found
}

fn gather(folder: &Path, prefix: &str, endings: &[&str], found: &mut Vec<Source>) {
    for entry in std::fs::read_dir(folder).unwrap().map(Result::unwrap) {
        let name = entry.file_name().into_string().unwrap();
        let path = format!("{prefix}{name}");
        let kind = entry.file_type().unwrap();
        if kind.is_dir()
            && !name.starts_with('.')
            && !["target", "reports", "corpus"].contains(&&*name)
        {
            gather(&entry.path(), &format!("{path}/"), endings, found);
        } else if kind.is_file() && endings.iter().any(|e| name.ends_with(e)) {
            let text = std::fs::read_to_string(entry.path()).unwrap();
            found.push(Source { path, text });
        }
    }
}

/// The folder of `drivers` that hold no part of the program; the others are its families.
const BESIDE_DRIVERS: &[&str] = &["drivers/tests/", "drivers/examples/", "drivers/peers/"];

/// Whether a Rust file belongs to a crate's library or program. The drivers' crate has no `src`: its
/// families are folders of its own.
fn is_of_a_crate(path: &str) -> bool {
    let is_driver = path.starts_with("drivers/")
        && !BESIDE_DRIVERS.iter().any(|folder| path.starts_with(folder));
    is_driver || path.contains("/src/") && !path.starts_with("drivers/")
}

/// Every Rust file that goes into the program: no tests, benches or examples.
#[must_use]
pub fn program() -> Vec<Source> {
    let all: Vec<Source> = files(&[".rs"]).into_iter().filter(|s| is_of_a_crate(&s.path)).collect();
    let tests: Vec<String> = all.iter().flat_map(test_modules).collect();
    let is_test = |path: &str| tests.iter().any(|t| path.starts_with(t.as_str()));
    all.into_iter()
        .filter(|s| !s.path.starts_with("tests/") && !is_test(&s.path))
        .map(|s| Source { text: without_test_blocks(&s.text), ..s })
        .collect()
}

/// Beginnings of the paths of the modules that a file declares behind `#[cfg(test)]`.
fn test_modules(source: &Source) -> Vec<String> {
    let (folder, name) = source.path.rsplit_once('/').unwrap();
    let folder = match name {
        "mod.rs" | "lib.rs" | "main.rs" => folder.to_owned(),
        _ => format!("{folder}/{}", name.trim_end_matches(".rs")),
    };
    let lines: Vec<&str> = source.text.lines().map(str::trim).collect();
    lines
        .windows(2)
        .filter(|pair| pair[0] == "#[cfg(test)]")
        .filter_map(|pair| pair[1].strip_prefix("mod ")?.strip_suffix(';'))
        .flat_map(|module| [format!("{folder}/{module}.rs"), format!("{folder}/{module}/")])
        .collect()
}

/// The text with every item behind `#[cfg(test)]` blanked.
fn without_test_blocks(text: &str) -> String {
    let code = code(text);
    let mut kept = text.to_owned();
    for (start, mark) in code.match_indices("#[cfg(test)]") {
        let item = after_attributes(&code, start + mark.len());
        let Some(open) = code[item..].find(['{', ';']).map(|at| item + at) else { continue };
        let block = code.as_bytes()[open] == b'{';
        let end = if block { end_of_block(&code, open) } else { open + 1 };
        kept.replace_range(start..end, &blank(&text[start..end]));
    }
    kept
}

/// Where the item begins whose further attributes begin at `at`.
fn after_attributes(code: &str, mut at: usize) -> usize {
    loop {
        at += code[at..].len() - code[at..].trim_start().len();
        match code[at..].strip_prefix("#[").and_then(|rest| rest.find(']')) {
            Some(close) => at += "#[".len() + close + 1,
            None => return at,
        }
    }
}

fn end_of_block(code: &str, open: usize) -> usize {
    let mut depth = 0_u32;
    for (at, byte) in code.bytes().enumerate().skip(open) {
        match byte {
            b'{' => depth += 1,
            b'}' => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return at + 1;
        }
    }
    code.len()
}

/// As many bytes, all spaces but the line feeds.
fn blank(text: &str) -> String {
    text.bytes().map(|b| if b == b'\n' { '\n' } else { ' ' }).collect()
}

/// Rust text with comments, strings and characters blanked; lines and columns stay.
#[must_use]
pub fn code(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let after_word = out.ends_with(|c: char| c.is_alphanumeric() || c == '_');
        let length = if after_word { None } else { raw_string(rest) };
        match length.or_else(|| literal(rest)) {
            Some(length) => {
                out.push_str(&blank(&rest[..length]));
                rest = &rest[length..];
            }
            None => {
                out.push(first);
                rest = &rest[first.len_utf8()..];
            }
        }
    }
    out
}

/// The length of the raw string that `text` begins with.
fn raw_string(text: &str) -> Option<usize> {
    let after = text.strip_prefix("br").or_else(|| text.strip_prefix('r'))?;
    let hashes = after.bytes().take_while(|b| *b == b'#').count();
    let body = after[hashes..].strip_prefix('"')?;
    let close = format!("\"{}", "#".repeat(hashes));
    let end = body.find(&close).map_or(body.len(), |at| at + close.len());
    Some(text.len() - body.len() + end)
}

/// The length of the comment, string or character that `text` begins with. Block comments are not
/// nested here: nobody nests them.
fn literal(text: &str) -> Option<usize> {
    if text.starts_with("//") {
        return Some(text.find('\n').unwrap_or(text.len()));
    }
    if text.starts_with("/*") {
        return Some(text.find("*/").map_or(text.len(), |at| at + 2));
    }
    if text.starts_with('"') {
        return Some(end_of_quote(text, '"'));
    }
    let inner = text.strip_prefix('\'')?;
    let mut chars = inner.chars();
    let first = chars.next()?;
    // What is not closed at once is a lifetime.
    (first == '\\' || chars.next() == Some('\'')).then(|| end_of_quote(text, '\''))
}

fn end_of_quote(text: &str, quote: char) -> usize {
    let mut escaped = false;
    for (at, c) in text.char_indices().skip(1) {
        match c {
            _ if escaped => escaped = false,
            '\\' => escaped = true,
            c if c == quote => return at + c.len_utf8(),
            _ => {}
        }
    }
    text.len()
}

/// The words of code: identifiers, keywords and numbers, each with its byte offset.
pub fn words(code: &str) -> impl Iterator<Item = (usize, &str)> {
    code.split(|c: char| !c.is_alphanumeric() && c != '_')
        .filter(|word| !word.is_empty())
        .map(|word| (word.as_ptr().addr() - code.as_ptr().addr(), word))
}

/// The line that an offset is in, trimmed, and its number.
#[must_use]
pub fn line_at(text: &str, offset: usize) -> (usize, &str) {
    let number = text[..offset].matches('\n').count();
    (number + 1, text.lines().nth(number).unwrap_or_default().trim())
}

/// Fails with one line for each offence.
///
/// # Panics
/// When there is one.
#[track_caller]
pub fn none(offences: &[String]) {
    assert!(offences.is_empty(), "{} offences:\n{}", offences.len(), offences.join("\n"));
}
