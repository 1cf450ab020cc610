//! What files in a folder mean: names, ends, order. Pure, but for [`look`].

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;
use std::time::SystemTime;

/// Programs that fill up the last block leave the end mark within this many bytes.
const TAIL: u64 = 1024;
/// JPEG: ISO/IEC 10918-1, B.1.1.3: end of image.
const END_OF_IMAGE: [u8; 2] = [0xff, 0xd9];
/// PNG: ISO/IEC 15948, 11.2.5: the last chunk, empty, with its check sum.
const END_CHUNK: [u8; 12] = [0, 0, 0, 0, b'I', b'E', b'N', b'D', 0xae, 0x42, 0x60, 0x82];

/// Which file names are pictures.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Pattern(Vec<String>);

impl Pattern {
    /// Several with commas between them. `None` where there is none.
    pub(super) fn read(text: &str) -> Option<Self> {
        let all: Vec<String> = text
            .split(',')
            .map(|one| one.trim().to_lowercase())
            .filter(|one| !one.is_empty())
            .collect();
        (!all.is_empty()).then_some(Self(all))
    }

    /// Whether a name is one of a picture. Hidden files never are: some programs write there first.
    pub(super) fn fits(&self, name: &str) -> bool {
        let name = name.to_lowercase();
        !name.starts_with('.') && self.0.iter().any(|one| glob(one.as_bytes(), name.as_bytes()))
    }
}

fn glob(pattern: &[u8], name: &[u8]) -> bool {
    match (pattern.split_first(), name.split_first()) {
        (None, rest) => rest.is_none(),
        (Some((b'*', behind)), _) => (0..=name.len()).any(|skip| glob(behind, &name[skip..])),
        (Some((b'?', behind)), Some((_, rest))) => glob(behind, rest),
        (Some((a, behind)), Some((b, rest))) => a == b && glob(behind, rest),
        (Some(_), None) => false,
    }
}

/// How far a picture's bytes have come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum End {
    /// The end mark stands at the end.
    There,
    /// It stands near the end: filled up, or the end of an inner picture.
    Near,
    /// There is none yet.
    Missing,
}

/// Looks for the end mark in the last bytes of a file.
pub(super) fn end(tail: &[u8]) -> End {
    let filled = tail.iter().rev().take_while(|byte| **byte == 0).count();
    let rest = &tail[..tail.len() - filled];
    if rest.ends_with(&END_OF_IMAGE) || tail.ends_with(&END_CHUNK) {
        End::There
    } else if tail.windows(2).any(|two| two == END_OF_IMAGE)
        || tail.windows(END_CHUNK.len()).any(|it| it == END_CHUNK)
    {
        End::Near
    } else {
        End::Missing
    }
}

/// Whether these are the bytes of a JPEG or PNG file.
pub(super) fn is_picture(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0xff, 0xd8, 0xff]) || bytes.starts_with(b"\x89PNG\r\n\x1a\n")
}

/// A file at one look.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Seen {
    /// Its name in the folder.
    pub(super) name: String,
    /// Bytes.
    pub(super) size: u64,
    /// When it was last written to, by the file system's own clock: only compared with others of
    /// the same folder.
    pub(super) written: SystemTime,
}

impl Seen {
    /// Orders files as they were taken: by the time of writing, and where that is the same by
    /// name, numbers in it by value.
    pub(super) fn order(&self) -> (SystemTime, Vec<(u64, String)>) {
        (self.written, natural(&self.name))
    }
}

fn natural(name: &str) -> Vec<(u64, String)> {
    let mut parts = vec![(0_u64, String::new())];
    let mut in_number = false;
    for letter in name.chars() {
        let digit = letter.to_digit(10).map(u64::from);
        if let Some((number, text)) = parts.last_mut() {
            match digit {
                Some(digit) if in_number => *number = number.wrapping_mul(10).wrapping_add(digit),
                Some(digit) => parts.push((digit, String::new())),
                None => text.push(letter),
            }
        }
        in_number = digit.is_some();
    }
    parts
}

/// The pictures in a folder.
///
/// # Errors
/// What the operating system says of the folder. A file that goes away meanwhile is none.
pub(super) fn look(folder: &Path, pattern: &Pattern) -> io::Result<Vec<Seen>> {
    let mut all = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if !pattern.fits(&name) {
            continue;
        }
        // Through a link too: some programs link their newest.
        if let Ok(about) = std::fs::metadata(entry.path())
            && about.is_file()
        {
            all.push(Seen { name, size: about.len(), written: about.modified()? });
        }
    }
    all.sort_by_key(Seen::order);
    Ok(all)
}

/// How far a file has come.
///
/// # Errors
/// What the operating system says.
pub(super) fn end_of(path: &Path, size: u64) -> io::Result<End> {
    let mut file = File::open(path)?;
    file.seek(SeekFrom::Start(size.saturating_sub(TAIL)))?;
    let mut tail = Vec::new();
    file.take(TAIL).read_to_end(&mut tail)?;
    Ok(end(&tail))
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn patterns_fit_names_with_capitals_or_not() {
        let pattern = Pattern::read("*.jpg, left_?.png").unwrap();
        for (name, fits) in [
            ("IMG_0001.JPG", true),
            ("a.jpg", true),
            ("left_1.png", true),
            ("left_12.png", false),
            ("a.jpg.part", false),
            (".hidden.jpg", false),
            ("a.cr2", false),
        ] {
            assert_eq!(pattern.fits(name), fits, "{name}");
        }
        assert_eq!(Pattern::read(" , "), None);
    }

    #[test]
    fn the_end_of_a_picture_is_told_from_its_middle() {
        let padded = [&[1, 2, 0xff, 0xd9][..], &[0; 40]].concat();
        let inner = [&[0xff, 0xd9][..], &[7; 40]].concat();
        let png = [&[1][..], &END_CHUNK].concat();
        for (tail, expected) in [
            (&[1, 2, 0xff, 0xd9][..], End::There),
            (&padded, End::There),
            (&png, End::There),
            (&inner, End::Near),
            (&[1, 2, 0xff], End::Missing),
            (&[], End::Missing),
        ] {
            assert_eq!(end(tail), expected, "{tail:?}");
        }
    }

    #[test]
    fn files_are_ordered_by_time_then_by_number() {
        let at = |s: u64, name: &str| Seen {
            name: name.to_owned(),
            size: 1,
            written: SystemTime::UNIX_EPOCH + Duration::from_secs(s),
        };
        let mut all = [at(2, "a.jpg"), at(1, "IMG_10.JPG"), at(1, "IMG_9.JPG")];
        all.sort_by_key(Seen::order);
        let names: Vec<&str> = all.iter().map(|it| it.name.as_str()).collect();
        assert_eq!(names, ["IMG_9.JPG", "IMG_10.JPG", "a.jpg"]);
    }
}
