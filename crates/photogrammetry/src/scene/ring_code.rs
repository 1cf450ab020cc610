//! 12-bit ring codes, as PhotoModeler, AICON and Metashape print them.
//!
//! Centre disc of radius r, code ring from 2r to 3r in 12 sectors of 30 degrees; a bit is 1 where
//! the sector has the colour of the centre disc; bits are read clockwise as seen from the front,
//! most significant first; the id is the smallest value over the 12 cyclic rotations.

/// Number of sectors.
pub const RING_BITS: u32 = 12;

/// The smallest value over all cyclic rotations.
#[must_use]
pub fn canonical_code(bits: u16) -> u16 {
    let mask = (1u16 << RING_BITS) - 1;
    let bits = bits & mask;
    (0..RING_BITS)
        .map(|turn| ((bits << turn) | (bits >> (RING_BITS - turn))) & mask)
        .min()
        .unwrap_or(bits)
}

/// The sectors of a code, clockwise as seen from the front, most significant bit first.
#[must_use]
pub fn ring_sectors(code: u16) -> [bool; RING_BITS as usize] {
    std::array::from_fn(|i| code >> (RING_BITS as usize - 1 - i) & 1 == 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_code_is_the_smallest_of_its_rotations() {
        assert_eq!(canonical_code(0b1000_0000_0000), 1);
        assert_eq!(canonical_code(0b1011_0100_0000), 0b10_1101);
        assert_eq!(canonical_code(45), 45);
        assert!(ring_sectors(45)[11] && !ring_sectors(45)[10] && ring_sectors(45)[6]);
    }
}
