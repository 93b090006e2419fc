//! The Huffman codes of a JPEG (ITU-T T.81, annex C).

/// Bits of the codes that are looked up at once: most of them, in a table that stays in the fastest cache.
const FAST: u8 = 9;

/// Codes and their symbols.
pub(super) struct HuffmanTable {
    /// Length in bits and symbol of the code that the next bits start with; length 0 for none as short as this.
    fast: Vec<(u8, u8)>,
    /// Of the longer ones, for each length: the first 16 bits behind its codes, and its symbols.
    long: Vec<(u32, Vec<u8>)>,
}

impl HuffmanTable {
    /// From the number of codes of each length, 1 to 16 bits, and their symbols in order of the codes; `None` for more codes than
    /// there can be.
    pub(super) fn new(counts: &[u8; 16], symbols: &[u8]) -> Option<Self> {
        let (mut fast, mut long) = (Vec::with_capacity(1 << FAST), Vec::new());
        let (mut rest, mut end) = (symbols, 0);
        for (length, &count) in (1..).zip(counts) {
            let (here, behind) = rest.split_at_checked(count.into())?;
            (rest, end) = (behind, end + (u32::from(count) << (16 - length)));
            if end > 1 << 16 {
                return None;
            }
            if length > FAST {
                long.push((end, here.to_vec()));
                continue;
            }
            for &symbol in here {
                fast.resize(fast.len() + (1 << (FAST - length)), (length, symbol));
            }
        }
        fast.resize(1 << FAST, (0, 0));
        Some(Self { fast, long })
    }

    /// Length and symbol of the code that these bits start with.
    pub(super) fn find(&self, bits: u16) -> Option<(u8, u8)> {
        let found = self.fast[usize::from(bits >> (16 - FAST))];
        if found.0 > 0 { Some(found) } else { self.find_long(bits.into()) }
    }

    fn find_long(&self, bits: u32) -> Option<(u8, u8)> {
        let (length, (end, symbols)) = (FAST + 1..).zip(&self.long).find(|(_, (end, _))| bits < *end)?;
        // Codes of a length lie one after another, the last of them before the end.
        let from_last = (end - 1 - bits) >> (16 - length);
        Some((length, symbols[symbols.len() - 1 - from_last as usize]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_of_every_length_are_found() {
        // One code of each length: 0, 10, 110 and so on, and none of ones alone.
        let symbols: Vec<u8> = (101..117).collect();
        let table = HuffmanTable::new(&[1; 16], &symbols).unwrap();
        for bits in 0..=u16::MAX {
            let length = bits.leading_ones() as u8 + 1;
            assert_eq!(table.find(bits), (length <= 16).then_some((length, 100 + length)), "{bits:016b}");
        }
    }

    #[test]
    fn codes_of_one_length_are_in_order() {
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
    fn more_codes_than_there_can_be_are_refused() {
        let mut counts = [0; 16];
        counts[0] = 3;
        assert!(HuffmanTable::new(&counts, &[1, 2, 3]).is_none());
    }
}
