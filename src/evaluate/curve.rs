//! A curve over the levels p, linear between those that were played.

/// The mean height of the curve through these points (p, y), ordered by p: the area below it by the trapezoidal
/// rule, over the range of p. `None` for fewer than two points.
pub(super) fn mean_height(points: &[(f64, f64)]) -> Option<f64> {
    let [(first, _), .., (last, _)] = points else { return None };
    let trapezoids = points.windows(2).map(|pair| (pair[1].0 - pair[0].0) * (pair[0].1 + pair[1].1) / 2.0);
    Some(trapezoids.sum::<f64>() / (last - first))
}

/// The lowest p from which on the curve stays at `height` or above; the lowest p of all if it does so everywhere,
/// `None` if it ends below.
pub(super) fn lowest_p(points: &[(f64, f64)], height: f64) -> Option<f64> {
    let below = points.iter().rposition(|(_, y)| *y < height);
    let Some(at) = below else { return points.first().map(|(p, _)| *p) };
    let ((p, y), (next_p, next_y)) = (points[at], *points.get(at + 1)?);
    Some(p + (next_p - p) * (height - y) / (next_y - y))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_height_worked_by_hand() {
        // 0.2 (1 + 3) / 2 + 0.3 (3 + 5) / 2 = 0.4 + 1.2 over 0.5.
        let height = mean_height(&[(0.0, 1.0), (0.2, 3.0), (0.5, 5.0)]).unwrap();
        assert!((height - 3.2).abs() < 1e-12, "{height}");
        assert_eq!(mean_height(&[(0.4, 2.0)]), None);
        assert_eq!(mean_height(&[]), None);
    }

    #[test]
    fn the_lowest_p_is_found_from_above() {
        // Between 0.5 and 1 the curve climbs from 0.8 to 1: 0.9 is half way. That it is above at 0 does not count.
        assert_eq!(lowest_p(&[(0.0, 0.95), (0.5, 0.8), (1.0, 1.0)], 0.9), Some(0.75));
        assert_eq!(lowest_p(&[(0.0, 0.5), (0.5, 0.9), (1.0, 1.0)], 0.9), Some(0.5));
        assert_eq!(lowest_p(&[(0.2, 0.9), (1.0, 1.0)], 0.9), Some(0.2));
        assert_eq!(lowest_p(&[(0.2, 0.95), (1.0, 0.85)], 0.9), None);
        assert_eq!(lowest_p(&[(1.0, 1.0)], 0.9), Some(1.0));
        assert_eq!(lowest_p(&[], 0.9), None);
    }
}
