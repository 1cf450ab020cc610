//! Pictures reduced and packed into the page.

use base64::Engine as _;
use beampose_photogrammetry::GrayImage;

/// A reduced picture.
pub struct Thumbnail {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// How many pixels of the original one pixel here stands for.
    pub reduction: f64,
    /// The picture as a `data:` URI.
    pub uri: String,
}

/// JPEG quality of pictures: artefacts stay below what the marks cover.
const QUALITY: u8 = 82;

/// Reduces `image` by a whole number so that it is at most `width` wide, and packs it as PNG or as
/// JPEG, whichever is smaller. `None` for an empty picture or one that cannot be encoded.
pub fn thumbnail(image: &GrayImage, width: usize) -> Option<Thumbnail> {
    if image.width == 0 || image.data.len() != image.width * image.height {
        return None;
    }
    let factor = image.width.div_ceil(width.max(1)).max(1);
    let small = reduce(image, factor);
    let (mime, bytes) = encode(&small)?;
    let text = base64::engine::general_purpose::STANDARD.encode(bytes);
    Some(Thumbnail {
        width: small.width,
        height: small.height,
        reduction: factor as f64,
        uri: format!("data:{mime};base64,{text}"),
    })
}

/// Means over blocks of `factor` x `factor` pixels; a rest at the right and lower edge is dropped.
fn reduce(image: &GrayImage, factor: usize) -> GrayImage {
    let (width, height) = (image.width / factor, image.height / factor);
    let area = factor * factor;
    let mut data = Vec::with_capacity(width * height);
    let mut sums = vec![0_usize; width];
    for y in 0..height {
        sums.fill(0);
        for line in y * factor..(y + 1) * factor {
            for (sum, block) in sums.iter_mut().zip(image.row(line).chunks_exact(factor)) {
                *sum += block.iter().map(|v| usize::from(*v)).sum::<usize>();
            }
        }
        data.extend(sums.iter().map(|s| u8::try_from((s + area / 2) / area).unwrap_or(u8::MAX)));
    }
    GrayImage { width, height, data }
}

fn encode(image: &GrayImage) -> Option<(&'static str, Vec<u8>)> {
    match (encode_png(image), encode_jpeg(image)) {
        (Some(png), Some(jpeg)) if jpeg.len() < png.len() => Some(("image/jpeg", jpeg)),
        (Some(png), _) => Some(("image/png", png)),
        (None, jpeg) => Some(("image/jpeg", jpeg?)),
    }
}

fn encode_png(image: &GrayImage) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    let (width, height) = (u32::try_from(image.width).ok()?, u32::try_from(image.height).ok()?);
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().ok()?;
    writer.write_image_data(&image.data).ok()?;
    writer.finish().ok()?;
    Some(bytes)
}

fn encode_jpeg(image: &GrayImage) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    let (width, height) = (u16::try_from(image.width).ok()?, u16::try_from(image.height).ok()?);
    let encoder = jpeg_encoder::Encoder::new(&mut bytes, QUALITY);
    encoder.encode(&image.data, width, height, jpeg_encoder::ColorType::Luma).ok()?;
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_averaged_and_the_rest_is_dropped() {
        let image = GrayImage { width: 5, height: 3, data: (0..15).map(|v| v * 10).collect() };
        let small = reduce(&image, 2);
        assert_eq!((small.width, small.height, small.data), (2, 1, vec![30, 50]));
    }

    #[test]
    fn a_thumbnail_decodes_to_what_was_reduced() {
        let image = GrayImage { width: 64, height: 48, data: vec![77; 64 * 48] };
        let small = thumbnail(&image, 32).unwrap();
        assert_eq!((small.width, small.height, small.reduction), (32, 24, 2.0));
        let (_, text) = small.uri.split_once(',').unwrap();
        let bytes = base64::engine::general_purpose::STANDARD.decode(text).unwrap();
        let decoded = beampose_photogrammetry::decode(&bytes).unwrap();
        assert_eq!((decoded.width, decoded.data[100]), (32, 77));
    }

    #[test]
    fn an_empty_picture_has_no_thumbnail() {
        assert!(thumbnail(&GrayImage { width: 0, height: 0, data: vec![] }, 100).is_none());
    }
}
