//! Huffman tables of a JPEG (ITU-T T.81, annex C).

/// Codes of up to this many bits are found by one table look-up. Longer codes are rare, and the
/// table of 2⁹ entries fits the L1 cache.
const LOOKUP_BITS: u8 = 9;

/// Codes and their symbols.
pub(super) struct HuffmanTable {
    /// Code length in bits and symbol, indexed by the next [`LOOKUP_BITS`] bits; length 0 if they
    /// start a longer code.
    short: Vec<(u8, u8)>,
    /// For each code length above [`LOOKUP_BITS`]: the first 16-bit value after its codes, and its
    /// symbols.
    long: Vec<(u32, Vec<u8>)>,
}

impl HuffmanTable {
    /// From the number of codes of each length, 1 to 16 bits, and their symbols in order of the
    /// codes; `None` if these are more codes than such lengths allow.
    pub(super) fn new(counts: &[u8; 16], symbols: &[u8]) -> Option<Self> {
        let (mut short, mut long) = (Vec::with_capacity(1 << LOOKUP_BITS), Vec::new());
        let (mut rest, mut end) = (symbols, 0);
        for (length, &count) in (1..).zip(counts) {
            let (of_length, longer) = rest.split_at_checked(count.into())?;
            (rest, end) = (longer, end + (u32::from(count) << (16 - length)));
            if end > 1 << 16 {
                return None;
            }
            if length > LOOKUP_BITS {
                long.push((end, of_length.to_vec()));
                continue;
            }
            for &symbol in of_length {
                short.resize(short.len() + (1 << (LOOKUP_BITS - length)), (length, symbol));
            }
        }
        short.resize(1 << LOOKUP_BITS, (0, 0));
        Some(Self { short, long })
    }

    /// Length in bits and symbol of the code that these bits start with.
    pub(super) fn find(&self, bits: u16) -> Option<(u8, u8)> {
        let found = self.short[usize::from(bits >> (16 - LOOKUP_BITS))];
        if found.0 > 0 { Some(found) } else { self.find_long(bits.into()) }
    }

    fn find_long(&self, bits: u32) -> Option<(u8, u8)> {
        let (length, (end, symbols)) = (LOOKUP_BITS + 1..).zip(&self.long).find(|(_, (end, _))| bits < *end)?;
        // Codes of one length are consecutive; the last one is just before the end.
        let from_last = (end - 1 - bits) >> (16 - length);
        Some((length, symbols[symbols.len() - 1 - from_last as usize]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn find_decodes_every_code_length() {
        // One code of each length: 0, 10, 110 and so on; no code consists of ones alone.
        let symbols: Vec<u8> = (101..117).collect();
        let table = HuffmanTable::new(&[1; 16], &symbols).unwrap();
        for bits in 0..=u16::MAX {
            let length = (!bits).leading_zeros() as u8 + 1;
            let expected = if bits == u16::MAX { None } else { Some((length, 100 + length)) };
            assert_eq!(table.find(bits), expected, "{bits:016b}");
        }
    }

    #[test]
    fn find_returns_symbols_in_order_of_codes_of_one_length() {
        let mut counts = [0; 16];
        (counts[1], counts[11]) = (2, 200);
        let symbols: Vec<u8> = (0..202).collect();
        let table = HuffmanTable::new(&counts, &symbols).unwrap();
        assert_eq!(table.find(0b0111_1111_1111_1111), Some((2, 1)));
        for code in 0..200 {
            for bits in [0, 15] {
                assert_eq!(table.find(0x8000 + 16 * code + bits), Some((12, code as u8 + 2)));
            }
        }
        assert_eq!(table.find(0x8000 + 16 * 200), None);
    }

    #[test]
    fn new_refuses_more_codes_than_their_lengths_allow() {
        let mut counts = [0; 16];
        counts[0] = 3;
        assert!(HuffmanTable::new(&counts, &[1, 2, 3]).is_none());
    }
}
