//! From a camera's pixels to those of a PNG file, and when a frame began. Pure.

use std::time::Duration;

/// How pixels come: names of V4L2.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Format {
    /// Two pixels in four bytes, with colour at half the width.
    Yuyv,
    /// Brightness, a byte.
    Grey,
    /// Brightness, two bytes, the low one first.
    Y16,
    /// Three bytes.
    Rgb,
    /// Three bytes, the other way round.
    Bgr,
    /// A JPEG file.
    Jpeg,
}

impl Format {
    /// By the four letters of V4L2.
    pub(super) fn read(text: &str) -> Option<Self> {
        Some(match text {
            "YUYV" => Self::Yuyv,
            "GREY" => Self::Grey,
            "Y16" => Self::Y16,
            "RGB3" => Self::Rgb,
            "BGR3" => Self::Bgr,
            "MJPG" => Self::Jpeg,
            _ => return None,
        })
    }

    /// The four letters.
    pub(super) const fn letters(self) -> &'static [u8; 4] {
        match self {
            Self::Yuyv => b"YUYV",
            Self::Grey => b"GREY",
            Self::Y16 => b"Y16 ",
            Self::Rgb => b"RGB3",
            Self::Bgr => b"BGR3",
            Self::Jpeg => b"MJPG",
        }
    }

    /// Bytes of a pixel as it comes.
    const fn width(self) -> usize {
        match self {
            Self::Yuyv | Self::Y16 => 2,
            Self::Rgb | Self::Bgr => 3,
            Self::Grey | Self::Jpeg => 1,
        }
    }
}

/// The pixels of a PNG file: 8 bits of grey or colour, or 16 bits of grey, high byte first.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Pixels {
    pub(super) colour: bool,
    pub(super) bits: u8,
    pub(super) bytes: Vec<u8>,
}

/// The pixels of a frame. `full`: whether YUYV uses all values, else 16 to 235 (240 for colour).
/// `None` where there are too few bytes, or the format has no pixels.
pub(super) fn pixels(
    format: Format,
    [width, height, stride]: [usize; 3],
    full: bool,
    bytes: &[u8],
) -> Option<Pixels> {
    let row = width * format.width();
    if format == Format::Jpeg || row == 0 || stride < row {
        return None;
    }
    if bytes.len() < stride * height.saturating_sub(1) + row {
        return None;
    }
    let rows = || bytes.chunks(stride).take(height).map(|line| &line[..row]);
    let grey = |bits, bytes| Pixels { colour: false, bits, bytes };
    let colour = |bytes| Pixels { colour: true, bits: 8, bytes };
    Some(match format {
        Format::Grey => grey(8, rows().flatten().copied().collect()),
        Format::Y16 => {
            grey(16, rows().flat_map(|line| line.chunks(2)).flat_map(|p| [p[1], p[0]]).collect())
        }
        Format::Rgb => colour(rows().flatten().copied().collect()),
        Format::Bgr => {
            let turned = |p: &[u8]| [p[2], p[1], p[0]];
            colour(rows().flat_map(|line| line.chunks_exact(3)).flat_map(turned).collect())
        }
        _ => {
            let two = |p: &[u8]| [rgb(p[0], p[1], p[3], full), rgb(p[2], p[1], p[3], full)];
            let pairs = rows().flat_map(|line| line.chunks_exact(4));
            colour(pairs.flat_map(two).flatten().collect())
        }
    })
}

/// ITU-R BT.601, 8 bits.
fn rgb(y: u8, u: u8, v: u8, full: bool) -> [u8; 3] {
    let (y, u, v) = (f32::from(y), f32::from(u) - 128.0, f32::from(v) - 128.0);
    let (y, u, v) = if full {
        (y, u, v)
    } else {
        ((y - 16.0) * 255.0 / 219.0, u * 255.0 / 224.0, v * 255.0 / 224.0)
    };
    [y + 1.402 * v, y - 0.344_136 * u - 0.714_136 * v, y + 1.772 * u]
        // A cast of a float stops at the ends of its range.
        .map(|x| x.round() as u8)
}

/// When a frame's exposure began at the earliest. A stamp of the end is later by at most a frame.
pub(super) fn began(stamp: Duration, is_begin: bool, interval: Duration) -> Duration {
    if is_begin { stamp } else { stamp.saturating_sub(interval) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_those_of_bt_601() {
        // BT.601, 100 % colour bars with limited range, and the ends of the full one.
        for (yuv, full, expected) in [
            ([16, 128, 128], false, [0, 0, 0]),
            ([235, 128, 128], false, [255, 255, 255]),
            ([81, 90, 240], false, [254, 0, 0]),
            ([145, 54, 34], false, [0, 255, 1]),
            ([41, 240, 110], false, [0, 0, 255]),
            ([0, 128, 128], true, [0, 0, 0]),
            ([255, 128, 128], true, [255, 255, 255]),
        ] {
            let found = rgb(yuv[0], yuv[1], yuv[2], full);
            let near = found.iter().zip(expected).all(|(a, b): (&u8, u8)| a.abs_diff(b) <= 1);
            assert!(near, "{yuv:?}: {found:?}");
        }
    }

    #[test]
    fn formats_are_named_as_v4l2_names_them() {
        for text in ["YUYV", "GREY", "Y16 ", "RGB3", "BGR3", "MJPG"] {
            let format = Format::read(text.trim_end()).unwrap();
            assert_eq!(format.letters().as_slice(), text.as_bytes());
        }
        assert_eq!(Format::read("H264"), None);
    }

    #[test]
    fn rows_are_taken_without_what_fills_them() {
        let bytes = [1, 2, 9, 9, 3, 4];
        let found = pixels(Format::Grey, [2, 2, 4], false, &bytes).unwrap();
        assert_eq!(found.bytes, [1, 2, 3, 4]);
        assert_eq!(pixels(Format::Grey, [2, 2, 4], false, &bytes[..5]), None);
        let deep = pixels(Format::Y16, [1, 1, 2], false, &[0x34, 0x12]).unwrap();
        assert_eq!((deep.bits, deep.bytes), (16, vec![0x12, 0x34]));
        let bgr = pixels(Format::Bgr, [1, 1, 3], false, &[1, 2, 3]).unwrap();
        assert_eq!(bgr.bytes, [3, 2, 1]);
        let two = pixels(Format::Yuyv, [2, 1, 4], true, &[10, 128, 20, 128]).unwrap();
        assert_eq!(two.bytes, [10, 10, 10, 20, 20, 20]);
    }

    #[test]
    fn a_stamp_of_the_end_is_a_frame_later_than_the_begin() {
        let ms = Duration::from_millis;
        assert_eq!(began(ms(100), true, ms(40)), ms(100));
        assert_eq!(began(ms(100), false, ms(40)), ms(60));
    }
}
