//! How fast something grows.

/// The exponent b of the power law y = a x^b that fits the points (x, y) best: least squares of the logarithms.
/// NaN for points of less than two x.
pub fn exponent(points: &[(f64, f64)]) -> f64 {
    let logarithms: Vec<(f64, f64)> = points.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
    let n = logarithms.len() as f64;
    let mean_x = logarithms.iter().map(|(x, _)| x).sum::<f64>() / n;
    let mean_y = logarithms.iter().map(|(_, y)| y).sum::<f64>() / n;
    let covariance: f64 = logarithms.iter().map(|(x, y)| (x - mean_x) * (y - mean_y)).sum();
    covariance / logarithms.iter().map(|(x, _)| (x - mean_x).powi(2)).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponent_of_a_power_law_is_found() {
        for b in [-1.0, 0.0, 0.5, 1.0, 1.75] {
            let points = [2.0, 4.0, 12.0, 64.0].map(|x: f64| (x, 3.5 * x.powf(b)));
            assert!((exponent(&points) - b).abs() < 1e-12, "{b}: {}", exponent(&points));
        }
    }

    #[test]
    fn errors_that_cancel_change_nothing() {
        let points = [(1.0, 2.0), (1.0, 0.5), (8.0, 16.0), (8.0, 4.0)];
        assert!((exponent(&points) - 1.0).abs() < 1e-12);
        assert!(exponent(&[(1.0, 2.0), (1.0, 3.0)]).is_nan());
    }
}
