//! Frame rates.

use std::cmp::Ordering;
use std::fmt;
use std::str::FromStr;

/// Frames per second, as a fraction: 30, 29.97 or 30000/1001.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameRate {
    /// Numerator, in lowest terms.
    pub frames: u32,
    /// Denominator, in lowest terms.
    pub seconds: u32,
}

impl FrameRate {
    /// The rate as a number.
    pub fn per_second(self) -> f64 {
        f64::from(self.frames) / f64::from(self.seconds)
    }
}

impl FromStr for FrameRate {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        let digits = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
        let number = |text: &str| text.parse::<u32>().ok().filter(|&number| number > 0 && digits(text));
        let parts = match (text.split_once('/'), text.split_once('.')) {
            (Some((frames, seconds)), _) => number(frames).zip(number(seconds)),
            (None, Some((_, decimals))) if (1..=6).contains(&decimals.len()) => {
                number(&text.replacen('.', "", 1)).zip(Some(10_u32.pow(decimals.len() as u32)))
            }
            _ => number(text).zip(Some(1)),
        };
        let (frames, seconds) = parts.ok_or(())?;
        let (mut divisor, mut rest) = (frames, seconds);
        while rest > 0 {
            (divisor, rest) = (rest, divisor % rest);
        }
        Ok(Self { frames: frames / divisor, seconds: seconds / divisor })
    }
}

impl Ord for FrameRate {
    fn cmp(&self, other: &Self) -> Ordering {
        let crossed = |a: u32, b: u32| u64::from(a) * u64::from(b);
        crossed(self.frames, other.seconds).cmp(&crossed(other.frames, self.seconds))
    }
}

impl PartialOrd for FrameRate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// In ffmpeg's notation.
impl fmt::Display for FrameRate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.seconds {
            1 => write!(f, "{}", self.frames),
            seconds => write!(f, "{}/{seconds}", self.frames),
        }
    }
}
