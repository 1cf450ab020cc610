//! Pictures: 8-bit grey in memory, decoded from a camera's JPEG or PNG bytes.

/// A grey picture of 8 bits, rows top to bottom.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GrayImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` values, row by row.
    pub data: Vec<u8>,
}

impl GrayImage {
    /// One row.
    #[must_use]
    pub fn row(&self, y: usize) -> &[u8] {
        &self.data[y * self.width..(y + 1) * self.width]
    }
}

/// Why bytes are not a picture that can be measured.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ImageError {
    /// Neither JPEG nor PNG.
    #[error("not a JPEG or PNG file (it begins with {0:02x?})")]
    NotAnImage(Vec<u8>),
    /// More pixels than a camera has.
    #[error("{width} x {height} pixels are more than the limit of {limit} megapixels")]
    TooLarge {
        /// Columns that the header claims.
        width: usize,
        /// Rows that the header claims.
        height: usize,
        /// The limit in megapixels.
        limit: usize,
    },
    /// The decoder gave up.
    #[error("damaged {format} file: {reason}")]
    Damaged {
        /// `JPEG` or `PNG`.
        format: &'static str,
        /// The decoder's words.
        reason: String,
    },
}

/// The largest picture that is decoded, in megapixels: well above any camera in use here, well
/// below what a forged header can claim.
pub const LIMIT_MEGAPIXELS: usize = 200;

/// Decodes a camera's JPEG or PNG file to grey.
///
/// # Errors
/// [`ImageError`] says what is wrong with the bytes; nothing is decoded from a damaged file, since
/// a grey block where dots should be would look like missing dots.
pub fn decode(bytes: &[u8]) -> Result<GrayImage, ImageError> {
    if bytes.starts_with(&[0xff, 0xd8]) {
        decode_jpeg(bytes)
    } else if bytes.starts_with(b"\x89PNG") {
        decode_png(bytes)
    } else {
        Err(ImageError::NotAnImage(bytes.iter().take(4).copied().collect()))
    }
}

fn check_size(width: usize, height: usize) -> Result<(), ImageError> {
    if width.saturating_mul(height) > LIMIT_MEGAPIXELS * 1_000_000 {
        return Err(ImageError::TooLarge { width, height, limit: LIMIT_MEGAPIXELS });
    }
    Ok(())
}

fn decode_jpeg(bytes: &[u8]) -> Result<GrayImage, ImageError> {
    use zune_core::bytestream::ZCursor;
    use zune_core::colorspace::ColorSpace;
    use zune_core::options::DecoderOptions;

    let damaged = |reason: String| ImageError::Damaged { format: "JPEG", reason };
    let options = DecoderOptions::default()
        .jpeg_set_out_colorspace(ColorSpace::Luma)
        .set_max_width(usize::from(u16::MAX))
        .set_max_height(usize::from(u16::MAX))
        .set_strict_mode(true);
    let mut decoder = zune_jpeg::JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(|e| damaged(e.to_string()))?;
    let (width, height) = decoder.dimensions().ok_or_else(|| damaged("no size".to_owned()))?;
    check_size(width, height)?;
    let data = decoder.decode().map_err(|e| damaged(e.to_string()))?;
    if data.len() != width * height {
        return Err(damaged(format!("{} grey values for {width} x {height} pixels", data.len())));
    }
    Ok(GrayImage { width, height, data })
}

fn decode_png(bytes: &[u8]) -> Result<GrayImage, ImageError> {
    let damaged = |reason: String| ImageError::Damaged { format: "PNG", reason };
    let mut decoder = png::Decoder::new(std::io::Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info().map_err(|e| damaged(e.to_string()))?;
    let (width, height) = (reader.info().width as usize, reader.info().height as usize);
    check_size(width, height)?;
    let size = reader.output_buffer_size().ok_or_else(|| damaged("too large".to_owned()))?;
    let mut data = vec![0; size];
    let info = reader.next_frame(&mut data).map_err(|e| damaged(e.to_string()))?;
    data.truncate(info.buffer_size());
    let samples = info.color_type.samples();
    let grey = match samples {
        1 => data,
        2 => data.chunks_exact(2).map(|p| p[0]).collect(),
        _ => data.chunks_exact(samples).map(luma).collect(),
    };
    Ok(GrayImage { width, height, data: grey })
}

/// Rec. 601 luma, as JPEG's own Y, so that the same scene gives the same grey from either format.
fn luma(pixel: &[u8]) -> u8 {
    let sum = 299 * u32::from(pixel[0]) + 587 * u32::from(pixel[1]) + 114 * u32::from(pixel[2]);
    u8::try_from((sum + 500) / 1000).unwrap_or(u8::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_that_are_no_picture_are_refused() {
        assert!(matches!(decode(b"GIF89a"), Err(ImageError::NotAnImage(_))));
        assert!(matches!(decode(b""), Err(ImageError::NotAnImage(_))));
        assert!(matches!(decode(&[0xff, 0xd8, 0xff]), Err(ImageError::Damaged { .. })));
    }
}
