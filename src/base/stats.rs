//! The statistics of a summary.

/// Mean of the values; NaN for none.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Unbiased standard deviation; `None` for fewer than two values.
pub fn std(values: &[f64]) -> Option<f64> {
    let mean = mean(values);
    let squares = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
    (values.len() > 1).then(|| (squares / (values.len() - 1) as f64).sqrt())
}

/// Half the width of the 95 % confidence interval of the mean, by Student's t. `None` for fewer than two values.
pub fn ci95(values: &[f64]) -> Option<f64> {
    let mut running = Running::default();
    values.iter().for_each(|value| running.push(*value));
    running.ci95()
}

/// Mean and spread of values that are not kept, by Welford's updates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Running {
    count: u64,
    mean: f64,
    squares: f64,
}

impl Running {
    /// Takes a value in.
    pub fn push(&mut self, value: f64) {
        self.count += 1;
        let from_old = value - self.mean;
        self.mean += from_old / self.count as f64;
        self.squares += from_old * (value - self.mean);
    }

    /// How many were taken in.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Half the width of the 95 % confidence interval of the mean, by Student's t. `None` for fewer than two values.
    pub fn ci95(&self) -> Option<f64> {
        let n = self.count as f64;
        let degrees_of_freedom = self.count.checked_sub(1).filter(|degrees| *degrees > 0)? as usize;
        let std = (self.squares / degrees_of_freedom as f64).sqrt();
        Some(t975(degrees_of_freedom) * std / n.sqrt())
    }
}

/// The value below which the share `q` of the values lies, which are in order; linear between them. NaN for none.
pub fn quantile(ordered: &[f64], q: f64) -> f64 {
    let Some(last) = ordered.len().checked_sub(1) else { return f64::NAN };
    let at = q * last as f64;
    let (low, high) = (ordered[at as usize], ordered[last.min(at as usize + 1)]);
    low + (high - low) * at.fract()
}

/// The 97.5 % quantile of Student's t distribution.
///
/// Tabulated where the expansion in 1/ν of Cornish and Fisher (Abramowitz and Stegun 26.7.5) is off by
/// more than 0.001.
fn t975(degrees_of_freedom: usize) -> f64 {
    const TABLE: [f64; 9] = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262];
    const Z: f64 = 1.959_963_985;
    if let Some(t) = TABLE.get(degrees_of_freedom.saturating_sub(1)) {
        return *t;
    }
    let nu = degrees_of_freedom as f64;
    let g1 = (Z.powi(3) + Z) / 4.0;
    let g2 = (5.0 * Z.powi(5) + 16.0 * Z.powi(3) + 3.0 * Z) / 96.0;
    let g3 = (3.0 * Z.powi(7) + 19.0 * Z.powi(5) + 17.0 * Z.powi(3) - 15.0 * Z) / 384.0;
    Z + g1 / nu + g2 / nu.powi(2) + g3 / nu.powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interval_worked_by_hand() {
        // Mean 2.5, variance 5/3, standard error sqrt(5/12), t(3) = 3.182.
        let values = [1.0, 2.0, 3.0, 4.0];
        assert_eq!(mean(&values), 2.5);
        assert_eq!(std(&values), Some((5.0f64 / 3.0).sqrt()));
        assert!((ci95(&values).unwrap() - 3.182 * (5.0f64 / 12.0).sqrt()).abs() < 1e-12);
        assert_eq!([ci95(&values[..1]), ci95(&[])], [None, None]);
    }

    #[test]
    fn quantiles_worked_by_hand() {
        let values = [1.0, 2.0, 4.0, 8.0, 16.0];
        let quantiles = [0.0, 0.25, 0.3, 0.975, 1.0].map(|q| quantile(&values, q));
        // 0.3 * 4 = 1.2, 0.975 * 4 = 3.9.
        for (quantile, expected) in quantiles.into_iter().zip([1.0, 2.0, 2.4, 15.2, 16.0]) {
            assert!((quantile - expected).abs() < 1e-12, "{quantile}");
        }
        assert_eq!(quantile(&[3.0], 0.975), 3.0);
        assert!(quantile(&[], 0.5).is_nan());
    }

    #[test]
    fn quantiles_of_t_agree_with_published_tables() {
        for (nu, t) in [(10, 2.2281), (20, 2.0860), (30, 2.0423), (100, 1.9840), (1000, 1.9623)] {
            assert!((t975(nu) - t).abs() < 2e-4, "t({nu}) = {}", t975(nu));
        }
    }
}
