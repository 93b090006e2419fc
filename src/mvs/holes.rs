//! Holes of a map: they take the farthest of their neighbours, ring by ring.

/// Pixels below 0 become the least of their 8 neighbours that are known, all of a ring at once, and so on; a map that knows
/// nothing becomes 0.
pub(super) fn grown(map: &[f32], width: usize) -> Vec<f32> {
    let height = map.len() / width;
    let mut map = map.to_vec();
    let mut holes: Vec<usize> = (0..map.len()).filter(|&at| map[at] < 0.0).collect();
    let mut filled = Vec::new();
    while !holes.is_empty() {
        holes.retain(|&at| {
            let (y, x) = (at / width, at % width);
            let mut least = f32::INFINITY;
            for row in y.saturating_sub(1)..(y + 2).min(height) {
                for &near in &map[row * width + x.saturating_sub(1)..row * width + (x + 2).min(width)] {
                    least = if near >= 0.0 && near < least { near } else { least };
                }
            }
            if least < f32::INFINITY {
                filled.push((at, least));
            }
            least == f32::INFINITY
        });
        if filled.is_empty() {
            holes.drain(..).for_each(|at| map[at] = 0.0);
        }
        filled.drain(..).for_each(|(at, value)| map[at] = value);
    }
    map
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hole_between_near_and_far_becomes_far() {
        let map = [2.0, -1.0, -1.0, -1.0, -1.0, 1.0];
        assert_eq!(grown(&map, 6), [2.0, 2.0, 2.0, 1.0, 1.0, 1.0]);
        assert_eq!(grown(&[2.0, -1.0, 1.0], 3), [2.0, 1.0, 1.0]);
        assert_eq!(grown(&[-1.0; 4], 2), [0.0; 4]);
    }

    #[test]
    fn infinity_is_a_depth() {
        assert_eq!(grown(&[0.0, -1.0, 1.0], 3), [0.0, 0.0, 1.0]);
    }
}
