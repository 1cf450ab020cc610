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
/// Colours become Rec. 601 luma. Sixteen bits become the upper eight of those that the camera has
/// (8, 10, 12, 14 or 16, whichever are the fewest that hold the brightest pixel). Pixels stay where
/// the file has them: an EXIF orientation is ignored, since calibrations are in the sensor's
/// coordinates, whichever way the camera was held.
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
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(|e| damaged(e.to_string()))?;
    let (width, height) = (reader.info().width as usize, reader.info().height as usize);
    check_size(width, height)?;
    let size = reader.output_buffer_size().ok_or_else(|| damaged("too large".to_owned()))?;
    let mut data = vec![0; size];
    let info = reader.next_frame(&mut data).map_err(|e| damaged(e.to_string()))?;
    data.truncate(info.buffer_size());
    let samples = info.color_type.samples();
    let data = match info.bit_depth {
        png::BitDepth::Sixteen => {
            let wide: Vec<u16> =
                data.chunks_exact(2).map(|b| u16::from_be_bytes([b[0], b[1]])).collect();
            to_eight_bits(&grey(wide, samples))
        }
        _ => grey(data, samples),
    };
    Ok(GrayImage { width, height, data })
}

/// One grey value for each pixel; transparency is ignored.
fn grey<T: Copy + Into<u32> + TryFrom<u32>>(data: Vec<T>, samples: usize) -> Vec<T> {
    match samples {
        1 => data,
        2 => data.chunks_exact(2).map(|p| p[0]).collect(),
        _ => data.chunks_exact(samples).map(|p| luma(p[0], p[1], p[2])).collect(),
    }
}

/// Rec. 601 luma, as JPEG's own Y, so that the same scene gives the same grey from either format.
fn luma<T: Copy + Into<u32> + TryFrom<u32>>(red: T, green: T, blue: T) -> T {
    let sum = 299 * red.into() + 587 * green.into() + 114 * blue.into();
    // A mean of three values never exceeds the largest, so it fits.
    T::try_from((sum + 500) / 1000).unwrap_or(green)
}

/// The upper 8 of the bits that the camera has, taken as the fewest of 8, 10, 12, 14 and 16 that
/// hold the brightest pixel: a 12-bit camera writes 0 to 4095 into its 16-bit files.
fn to_eight_bits(wide: &[u16]) -> Vec<u8> {
    let brightest = wide.iter().fold(0, |most, &value| most.max(value));
    let depth = [8, 10, 12, 14].into_iter().find(|&bits| brightest >> bits == 0).unwrap_or(16);
    wide.iter().map(|&value| (value >> (depth - 8)) as u8).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn png_file(
        width: u32,
        height: u32,
        color: png::ColorType,
        depth: png::BitDepth,
        data: &[u8],
    ) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width, height);
        encoder.set_color(color);
        encoder.set_depth(depth);
        encoder.write_header().unwrap().write_image_data(data).unwrap();
        bytes
    }

    fn wide_png(values: &[u16]) -> Vec<u8> {
        let data: Vec<u8> = values.iter().flat_map(|v| v.to_be_bytes()).collect();
        png_file(values.len() as u32, 1, png::ColorType::Grayscale, png::BitDepth::Sixteen, &data)
    }

    /// A JPEG file of smooth grey, 64 x 48 pixels, darker at the top left.
    fn jpeg_file(exif: Option<&[u8]>) -> Vec<u8> {
        let data: Vec<u8> = (0..64 * 48).map(|i| (2 * (i % 64) + i / 64) as u8).collect();
        let mut bytes = Vec::new();
        let mut encoder = jpeg_encoder::Encoder::new(&mut bytes, 95);
        if let Some(exif) = exif {
            encoder.add_app_segment(1, exif.to_vec()).unwrap();
        }
        encoder.encode(&data, 64, 48, jpeg_encoder::ColorType::Luma).unwrap();
        bytes
    }

    #[test]
    fn bytes_that_are_no_picture_are_refused() {
        assert!(matches!(decode(b"GIF89a"), Err(ImageError::NotAnImage(_))));
        assert!(matches!(decode(b""), Err(ImageError::NotAnImage(_))));
        assert!(matches!(decode(&[0xff, 0xd8, 0xff]), Err(ImageError::Damaged { .. })));
    }

    #[test]
    fn a_truncated_file_is_refused_wherever_it_ends() {
        let grey = png::ColorType::Grayscale;
        let data: Vec<u8> = (0..64 * 48).map(|i| (i * i % 251) as u8).collect();
        for whole in [jpeg_file(None), png_file(64, 48, grey, png::BitDepth::Eight, &data)] {
            assert!(decode(&whole).is_ok());
            for part in 1..10 {
                let cut = &whole[..whole.len() * part / 10];
                assert!(matches!(decode(cut), Err(ImageError::Damaged { .. })), "{part} tenths");
            }
        }
    }

    #[test]
    fn a_header_that_claims_too_much_is_refused_before_memory_is_taken() {
        let grey = png::ColorType::Grayscale;
        let mut png = png_file(1, 1, grey, png::BitDepth::Eight, &[7]);
        png[16..20].copy_from_slice(&60_000u32.to_be_bytes());
        png[20..24].copy_from_slice(&60_000u32.to_be_bytes());
        let checksum = crc(&png[12..29]);
        png[29..33].copy_from_slice(&checksum.to_be_bytes());
        let mut jpeg = jpeg_file(None);
        let frame = jpeg.windows(2).position(|pair| pair == [0xff, 0xc0]).unwrap();
        jpeg[frame + 5..frame + 7].copy_from_slice(&60_000u16.to_be_bytes());
        jpeg[frame + 7..frame + 9].copy_from_slice(&60_000u16.to_be_bytes());
        for bytes in [png, jpeg] {
            let error = decode(&bytes).unwrap_err();
            let expected =
                ImageError::TooLarge { width: 60_000, height: 60_000, limit: LIMIT_MEGAPIXELS };
            assert_eq!(error, expected);
        }
    }

    /// The checksum of a PNG chunk, bit by bit.
    fn crc(bytes: &[u8]) -> u32 {
        let bit = |c: u32| if c & 1 == 1 { 0xedb8_8320 ^ (c >> 1) } else { c >> 1 };
        !bytes.iter().fold(!0, |c, &byte| (0..8).fold(c ^ u32::from(byte), |c, _| bit(c)))
    }

    #[test]
    fn a_single_pixel_is_a_picture() {
        let bytes = png_file(1, 1, png::ColorType::Grayscale, png::BitDepth::Eight, &[7]);
        assert_eq!(decode(&bytes), Ok(GrayImage { width: 1, height: 1, data: vec![7] }));
    }

    #[test]
    fn colours_become_luma() {
        let (rgb, rgba) = (png::ColorType::Rgb, png::ColorType::Rgba);
        let primaries = [255, 0, 0, 0, 255, 0, 0, 0, 255, 90, 90, 90];
        let bytes = png_file(4, 1, rgb, png::BitDepth::Eight, &primaries);
        assert_eq!(decode(&bytes).unwrap().data, [76, 150, 29, 90]);
        let bytes = png_file(1, 1, rgba, png::BitDepth::Eight, &[0, 255, 0, 3]);
        assert_eq!(decode(&bytes).unwrap().data, [150]);
    }

    #[test]
    fn sixteen_bits_keep_the_bits_that_the_camera_has() {
        // 8, 10, 12, 14, 16 bits; the darkest values keep their share.
        assert_eq!(decode(&wide_png(&[0, 100, 255])).unwrap().data, [0, 100, 255]);
        assert_eq!(decode(&wide_png(&[4, 512, 1023])).unwrap().data, [1, 128, 255]);
        assert_eq!(decode(&wide_png(&[16, 480, 2047])).unwrap().data, [1, 30, 127]);
        assert_eq!(decode(&wide_png(&[64, 9000])).unwrap().data, [1, 140]);
        assert_eq!(decode(&wide_png(&[256, 65535])).unwrap().data, [1, 255]);
    }

    #[test]
    fn pixels_stay_where_the_sensor_has_them_whatever_exif_says() {
        // Orientation 6: the camera was turned by a quarter.
        let exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0";
        let image = decode(&jpeg_file(Some(exif))).unwrap();
        assert_eq!((image.width, image.height), (64, 48));
        assert_eq!(image, decode(&jpeg_file(None)).unwrap());
    }
}
