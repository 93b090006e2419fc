//! Follows the Huffman codes of one scan of a JPEG (ITU-T T.81, annexes F and G) without making a picture of them.

use super::jpeg_huffman::HuffmanTable;

const NO_CODE: &str = "the JPEG's compressed data is damaged: a code that does not exist";
const BEYOND: &str = "the JPEG's compressed data is damaged: more coefficients than a block has";
const SHORT: &str = "the JPEG's compressed data is damaged: it ends before the picture does";
const LEFT: &str = "the JPEG's compressed data is damaged: more of it than the picture has";

/// A channel of the picture.
pub(super) struct Component {
    pub(super) id: u8,
    /// Blocks across and down in a group of a scan of several channels.
    pub(super) sampling: (usize, usize),
    /// Blocks across and down in a scan of this channel alone.
    pub(super) blocks: (usize, usize),
    /// Blocks between one row of them and the next.
    pub(super) stride: usize,
    /// Of a progressive picture: for each block a bit for each coefficient that is not 0, which later scans refine.
    pub(super) nonzero: Vec<u64>,
}

/// What a scan holds.
pub(super) struct Scan {
    /// Index of the channel, numbers of its DC and its AC table.
    pub(super) channels: Vec<(usize, usize, usize)>,
    /// Groups of blocks across and down; of one channel, blocks.
    pub(super) groups: (usize, usize),
    /// First and last coefficient.
    pub(super) band: (usize, usize),
    pub(super) progressive: bool,
    /// Whether it adds bits to what earlier scans told.
    pub(super) refines: bool,
    /// Groups between restart markers; 0 for none.
    pub(super) restart_interval: usize,
}

/// The way through a scan's data.
pub(super) struct Walk<'a> {
    scan: &'a Scan,
    tables: &'a [[Option<HuffmanTable>; 4]; 2],
    components: &'a mut [Component],
    data: &'a [u8],
    at: usize,
    /// The next bits, from the highest; zeros behind the last.
    bits: u64,
    count: u32,
    /// Blocks that follow without a further coefficient in this band.
    end_of_band: u32,
}

impl<'a> Walk<'a> {
    pub(super) fn new(
        scan: &'a Scan,
        tables: &'a [[Option<HuffmanTable>; 4]; 2],
        components: &'a mut [Component],
        data: &'a [u8],
    ) -> Self {
        Self { scan, tables, components, data, at: 0, bits: 0, count: 0, end_of_band: 0 }
    }

    /// Length of the data, up to the marker behind it.
    pub(super) fn follow(mut self) -> Result<usize, &'static str> {
        let (across, down) = self.scan.groups;
        for group in 0..across * down {
            if self.scan.restart_interval > 0 && group > 0 && group.is_multiple_of(self.scan.restart_interval) {
                self.restart()?;
            }
            let (x, y) = (group % across, group / across);
            if let &[(channel, dc, ac)] = self.scan.channels.as_slice() {
                self.block(channel, dc, ac, x, y)?;
                continue;
            }
            for &(channel, dc, ac) in &self.scan.channels {
                let (h, v) = self.components[channel].sampling;
                for block in 0..h * v {
                    self.block(channel, dc, ac, x * h + block % h, y * v + block / h)?;
                }
            }
        }
        self.end()?;
        Ok(self.at)
    }

    fn block(&mut self, channel: usize, dc: usize, ac: usize, x: usize, y: usize) -> Result<(), &'static str> {
        let (first, last) = self.scan.band;
        if !self.scan.progressive {
            self.dc(dc)?;
            return self.ac_first(ac, 1, 63, None);
        }
        let at = y * self.components[channel].stride + x;
        match (first, self.scan.refines) {
            (0, true) => self.take(1).map(drop),
            (0, false) => self.dc(dc),
            (_, false) => self.ac_first(ac, first, last, Some((channel, at))),
            (_, true) => self.ac_refine(ac, first, last, (channel, at)),
        }
    }

    fn dc(&mut self, table: usize) -> Result<(), &'static str> {
        let size = self.symbol(self.table(0, table)?, 0x1F)?;
        if size > 16 { Err(NO_CODE) } else { Ok(()) }
    }

    /// Coefficients `first` to `last` of a block, or that there are no more.
    fn ac_first(
        &mut self,
        table: usize,
        first: usize,
        last: usize,
        block: Option<(usize, usize)>,
    ) -> Result<(), &'static str> {
        if self.end_of_band > 0 {
            self.end_of_band -= 1;
            return Ok(());
        }
        let table = self.table(1, table)?;
        let mut k = first;
        while k <= last {
            let symbol = self.symbol(table, 0x0F)?;
            let (run, size) = (symbol >> 4, symbol & 15);
            match (run, size) {
                (15, 0) => k += 16,
                (_, 0) if run > 0 && !self.scan.progressive => return Err(NO_CODE),
                (_, 0) => {
                    self.end_of_band = (1 << run) + self.take(run.into())? - 1;
                    return Ok(());
                }
                _ => {
                    k += usize::from(run);
                    if k > last {
                        return Err(BEYOND);
                    }
                    if let Some((channel, at)) = block {
                        *self.components[channel].nonzero.get_mut(at).ok_or(BEYOND)? |= 1 << k;
                    }
                    k += 1;
                }
            }
        }
        if k > last + 1 { Err(BEYOND) } else { Ok(()) }
    }

    /// One more bit of the coefficients that are not 0, and new ones among the others.
    fn ac_refine(
        &mut self,
        table: usize,
        first: usize,
        last: usize,
        (channel, at): (usize, usize),
    ) -> Result<(), &'static str> {
        let known = *self.components[channel].nonzero.get(at).ok_or(BEYOND)?;
        let table = self.table(1, table)?;
        let (mut new, mut k) = (0, first);
        while self.end_of_band == 0 && k <= last {
            let symbol = self.symbol(table, 0)?;
            let (mut run, size) = (symbol >> 4, symbol & 15);
            match size {
                0 if run < 15 => {
                    self.end_of_band = (1 << run) + self.take(run.into())?;
                    break;
                }
                0 => {}
                1 => drop(self.take(1)?),
                _ => return Err(NO_CODE),
            }
            // Past `run` zeros, to the zero that the new coefficient takes the place of.
            loop {
                if k > last {
                    return Err(BEYOND);
                }
                if known >> k & 1 == 1 {
                    self.take(1)?;
                } else if run > 0 {
                    run -= 1;
                } else {
                    break;
                }
                k += 1;
            }
            new |= u64::from(size == 1) << k;
            k += 1;
        }
        if self.end_of_band > 0 {
            for k in k..=last {
                self.take((known >> k & 1) as u32)?;
            }
            self.end_of_band -= 1;
        }
        self.components[channel].nonzero[at] |= new;
        Ok(())
    }

    /// A table of the class (0: DC, 1: AC).
    fn table(&self, class: usize, number: usize) -> Result<&'a HuffmanTable, &'static str> {
        self.tables[class][number].as_ref().ok_or(NO_CODE)
    }

    /// Symbol of the next code; the bits of a value that follow, as many as its bits in `size` say, are passed over.
    fn symbol(&mut self, table: &HuffmanTable, size: u8) -> Result<u8, &'static str> {
        if self.count < 32 {
            self.fill();
        }
        let found = table.find((self.bits >> 48) as u16);
        let (length, symbol) = found.ok_or(if self.count < 16 { SHORT } else { NO_CODE })?;
        let passed = u32::from(length + (symbol & size));
        self.count = self.count.checked_sub(passed).ok_or(SHORT)?;
        self.bits <<= passed;
        Ok(symbol)
    }

    fn take(&mut self, count: u32) -> Result<u32, &'static str> {
        if self.count < count {
            self.fill();
        }
        self.count = self.count.checked_sub(count).ok_or(SHORT)?;
        let taken = (self.bits >> 1 >> (63 - count)) as u32;
        self.bits <<= count;
        Ok(taken)
    }

    /// At least 32 bits, unless the data ends.
    fn fill(&mut self) {
        while self.count <= 32 {
            let next = self.data.get(self.at..).and_then(<[u8]>::first_chunk::<4>);
            if let Some(next) = next.filter(|next| !next.contains(&0xFF)) {
                self.bits |= u64::from(u32::from_be_bytes(*next)) << (32 - self.count);
                (self.at, self.count) = (self.at + 4, self.count + 32);
                return;
            }
            let byte = match self.data.get(self.at..) {
                Some([0xFF, 0x00, ..]) => {
                    self.at += 2;
                    0xFF
                }
                None | Some([] | [0xFF, ..]) => return,
                Some([byte, ..]) => {
                    self.at += 1;
                    *byte
                }
            };
            self.bits |= u64::from(byte) << (56 - self.count);
            self.count += 8;
        }
    }

    /// Only the bits that fill the last byte may be left, and then comes a marker.
    fn end(&mut self) -> Result<(), &'static str> {
        self.fill();
        if self.count >= 8 || self.end_of_band > 0 {
            return Err(LEFT);
        }
        while self.data.get(self.at..self.at + 2) == Some(&[0xFF, 0xFF]) {
            self.at += 1;
        }
        if self.at + 1 < self.data.len() { Ok(()) } else { Err("the JPEG data ends early") }
    }

    fn restart(&mut self) -> Result<(), &'static str> {
        self.end()?;
        match self.data[self.at + 1] {
            0xD0..=0xD7 => self.at += 2,
            _ => return Err(SHORT),
        }
        (self.bits, self.count, self.end_of_band) = (0, 0, 0);
        Ok(())
    }
}
