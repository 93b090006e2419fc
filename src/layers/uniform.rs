//! Planes evenly spaced in disparity (the paper's).

use super::error::LayersError;

/// `count` disparities (1/scene unit) evenly spaced from 1/near to 1/far, near → far; a single one
/// lies in the middle. Depths in scene units; `far` may be infinite.
///
/// # Errors
///
/// [`LayersError::Range`] unless 0 < near < far; [`LayersError::Empty`] for a count of 0.
pub fn uniform_disparities(near: f64, far: f64, count: usize) -> Result<Vec<f64>, LayersError> {
    if !(near > 0.0 && near < far && near.is_finite() && ((1.0 / near) as f32).is_finite()) {
        return Err(LayersError::Range { near, far });
    }
    let (nearest, farthest) = (1.0 / near, 1.0 / far);
    Ok(match count {
        0 => return Err(LayersError::Empty),
        1 => vec![0.5 / near + 0.5 / far],
        _ => (0..count).map(|k| nearest + k as f64 / (count - 1) as f64 * (farthest - nearest)).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniform_planes_run_from_near_to_far_and_reach_infinity() {
        assert_eq!(uniform_disparities(0.5, f64::INFINITY, 3).unwrap(), [2.0, 1.0, 0.0]);
        assert_eq!(uniform_disparities(1.0, 2.0, 1).unwrap(), [0.75]);
    }
}
