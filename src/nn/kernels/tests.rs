use super::elementwise::{Relu, Sigmoid, Tanh};
use super::linear::Linear;
use super::*;

#[test]
fn what_is_not_finite_is_found_wherever_it_is() {
    let mut values = vec![f32::MAX; 37];
    assert!(all_finite(&values) && all_finite(&[]));
    for at in [0, 16, 36] {
        for wrong in [f32::INFINITY, f32::NEG_INFINITY, f32::NAN] {
            values[at] = wrong;
            assert!(!all_finite(&values));
        }
        values[at] = -0.0;
    }
}

#[test]
fn a_sum_takes_every_value_once() {
    for n in [1, 15, 16, 127, 128, 129, 1000] {
        // Whole numbers, so that the order makes no difference.
        let values: Vec<f32> = (0..n).map(|at| at as f32).collect();
        assert_eq!(sum(&values), (n * (n - 1)) as f32 / 2.0);
    }
}
use crate::base::rng::{Draws, Purpose};
use proptest::prelude::*;

/// Every instruction set that this machine has, because each one is a code path.
fn arches() -> Vec<Arch> {
    let mut arches = vec![Arch::Scalar, *ARCH];
    #[cfg(target_arch = "x86_64")]
    arches.extend(pulp::x86::V3::try_new().map(Arch::V3));
    arches
}

fn numbers(seed: u64, n: usize, scale: f64) -> Vec<f32> {
    let mut draws = Draws::new(seed, Purpose::Weights, 0, 0);
    (0..n).map(|_| draws.between(-scale, scale) as f32).collect()
}

fn linear_on(arch: Arch, rows: usize, x: &[f32], weight: &[f32], start: Start, y: &mut [f32]) {
    if let Some(op) = Linear::new(rows, x, weight, start, y) {
        arch.dispatch(op);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn linear_is_the_product(rows in 1usize..20, k in 0usize..70, n in 1usize..700, seed in any::<u64>()) {
        let (x, weight) = (numbers(seed, rows * k, 1.0), numbers(seed ^ 1, k * n, 1.0));
        let (bias, before) = (numbers(seed ^ 2, n, 1.0), numbers(seed ^ 3, rows * n, 1.0));
        for arch in arches() {
            let mut y = before.clone();
            linear_on(arch, rows, &x, &weight, Start::Bias(&bias), &mut y);
            let mut sum = before.clone();
            linear_on(arch, rows, &x, &weight, Start::Output, &mut sum);
            let mut alone = before.clone();
            linear_on(arch, rows, &x, &weight, Start::Zero, &mut alone);
            for (r, c) in (0..rows).flat_map(|r| (0..n).map(move |c| (r, c))) {
                let product: f64 =
                    (0..k).map(|i| x[r * k + i] as f64 * weight[i * n + c] as f64).sum();
                let (at, tolerance) = (r * n + c, 1e-6 * (k + 1) as f64);
                prop_assert!((y[at] as f64 - product - bias[c] as f64).abs() < tolerance);
                prop_assert!((sum[at] as f64 - product - before[at] as f64).abs() < tolerance);
                prop_assert!((alone[at] as f64 - product).abs() < tolerance);
            }
        }
    }

    #[test]
    fn a_row_is_the_same_bits_alone_and_among_others(k in 1usize..60, n in 1usize..700, seed in any::<u64>()) {
        same_bits_alone_and_among_others(k, n, seed);
    }
}

#[test]
fn a_row_is_the_same_bits_at_the_sizes_of_the_paper() {
    for (k, n) in [(16, 256), (256, 256), (256, 768), (128, 512), (128, 32), (256, 5), (600, 300)] {
        same_bits_alone_and_among_others(k, n, 7);
    }
}

fn same_bits_alone_and_among_others(k: usize, n: usize, seed: u64) {
    let (weight, mut bias) = (numbers(seed ^ 1, k * n, 1.0), numbers(seed ^ 2, n, 1.0));
    bias.iter_mut().step_by(3).for_each(|bias| *bias = -0.0);
    let mut x = numbers(seed, 64 * k, 1.0);
    // Zeros, which a single row skips: every other row as a ReLU leaves it, and one of nothing else.
    x.chunks_mut(k).step_by(2).flatten().for_each(|x| *x = x.max(0.0));
    x[k..2 * k].fill(0.0);
    for arch in arches() {
        let run = |rows: usize, x: &[f32]| {
            let mut y = vec![0.0; rows * n];
            linear_on(arch, rows, x, &weight, Start::Bias(&bias), &mut y);
            y
        };
        let alone: Vec<f32> = x.chunks(k).flat_map(|row| run(1, row)).collect();
        for rows in [2, 3, 5, 6, 10, 64] {
            let together = run(rows, &x[..rows * k]);
            assert_eq!(bits(&together), bits(&alone[..rows * n]), "{arch:?}, {rows} rows, k {k}, n {n}");
        }
    }
}

#[test]
fn weights_of_f16_make_the_same_bits_as_their_values() {
    if !take_halves() {
        return println!("skipped: this machine converts f16 first");
    }
    for (k, n) in [(1, 1), (3, 15), (24, 16), (16, 255), (256, 256), (256, 768), (28, 273), (256, 5)] {
        let halves = numbers(5, k * n, 1.0).into_iter().map(half::f16::from_f32);
        // The smallest f16 that there is, too: it has no implicit bit.
        let halves: Vec<_> = halves.chain([half::f16::from_bits(1)]).skip(1).collect();
        let values: Vec<f32> = halves.iter().map(|half| half.to_f32()).collect();
        let halves: Vec<u16> = halves.iter().map(|half| half.to_bits()).collect();
        for rows in [1, 2, 3, 7] {
            let (x, bias) = (numbers(6, rows * k, 1.0), numbers(7, n, 1.0));
            for start in [Start::Bias(&bias), Start::Output, Start::Zero] {
                let [mut of_values, mut of_halves] = [numbers(8, rows * n, 1.0), numbers(8, rows * n, 1.0)];
                linear(rows, &x, &values, start, &mut of_values);
                linear_of_halves(rows, &x, &halves, start, &mut of_halves);
                assert_eq!(bits(&of_values), bits(&of_halves), "{rows} rows, k {k}, n {n}, {start:?}");
            }
        }
    }
}

#[test]
fn weights_of_four_bits_make_the_same_bits_on_every_machine() {
    for (k, n) in [(1, 1), (7, 5), (33, 128), (64, 129), (256, 768), (1030, 40)] {
        let weight = numbers(1, k * n, 0.5);
        let (bias, nibbles) = (numbers(2, n, 1.0), Nibbles::nearest(&weight, n));
        // Half of them zeros, a row of nothing else, and a row of the largest sums that there are.
        let zeros = numbers(3, k, 1.0).into_iter().map(|x| x.max(0.0));
        let x: Vec<f32> = zeros.chain(vec![0.0; k]).chain(vec![-2.0; k]).chain(numbers(4, k, 2.0)).collect();
        let rows = 4;
        let run = |arch, start| {
            let mut y = numbers(5, rows * n, 1.0);
            nibbles::run_on(arch, rows, &x, &nibbles, start, &mut y);
            y
        };
        let mut expected = vec![0.0; rows * n];
        for (x, y) in x.chunks(k).zip(expected.chunks_mut(n)) {
            y.copy_from_slice(&bias);
            for (block, x) in x.chunks(1024).enumerate() {
                let largest = x.iter().fold(0.0f32, |largest, x| largest.max(x.abs()));
                let whole: Vec<i64> =
                    x.iter().map(|x| (x / largest * 127.0).round_ties_even() as i64).collect();
                for (column, y) in y.iter_mut().enumerate().filter(|_| largest > 0.0) {
                    let values = weight.iter().skip(column).step_by(n);
                    let low = values.clone().copied().fold(f32::INFINITY, f32::min);
                    let high = values.clone().copied().fold(f32::NEG_INFINITY, f32::max);
                    let step = (high - low) / 15.0;
                    let steps = values
                        .map(|value| if step > 0.0 { ((value - low) / step).round() as i64 } else { 0 });
                    let sum: i64 = steps.skip(block * 1024).zip(&whole).map(|(steps, x)| steps * x).sum();
                    let total = whole.iter().sum::<i64>() as f32;
                    *y += largest / 127.0 * (step * sum as f32 + low * total);
                }
            }
        }
        for arch in arches() {
            assert_eq!(bits(&run(arch, Start::Bias(&bias))), bits(&expected), "{arch:?}, k {k}, n {n}");
            let [before, zeros] = [numbers(5, rows * n, 1.0), vec![0.0; rows * n]];
            for (start, before) in [(Start::Output, before), (Start::Zero, zeros)] {
                // A row of zeros leaves everything as it is.
                assert_eq!(run(arch, start)[n..2 * n], before[n..2 * n], "{arch:?}, k {k}, n {n}, {start:?}");
            }
        }
    }
}

#[test]
fn weights_of_four_bits_are_nearly_what_they_were() {
    let (k, n) = (256, 300);
    let (weight, x) = (numbers(1, k * n, 0.5), numbers(2, k, 1.0));
    let [mut exact, mut rough] = [vec![0.0; n], vec![0.0; n]];
    linear(1, &x, &weight, Start::Zero, &mut exact);
    linear_of_nibbles(1, &x, &Nibbles::nearest(&weight, n), Start::Zero, &mut rough);
    let wrong: Vec<f32> = exact.iter().zip(&rough).map(|(exact, rough)| exact - rough).collect();
    // The deviation of a value that is rounded to steps of 1/15, times that of the inputs and the root of how many there are.
    let expected = 1.0 / 15.0 / 12f64.sqrt() * (k as f64 / 3.0).sqrt();
    let deviation = (sum_of_squares(&wrong) / n as f64).sqrt();
    assert!((deviation / expected - 1.0).abs() < 0.2, "{deviation}, expected {expected}");
}

#[test]
fn instruction_sets_with_fused_multiply_add_agree_to_the_bit() {
    let (x, weight, bias) = (numbers(1, 10 * 33, 1.0), numbers(2, 33 * 77, 1.0), numbers(3, 77, 1.0));
    let mut results = Vec::new();
    for arch in arches().into_iter().filter(|arch| !matches!(arch, Arch::Scalar)) {
        let mut y = vec![0.0; 770];
        linear_on(arch, 10, &x, &weight, Start::Bias(&bias), &mut y);
        arch.dispatch(Tanh(&mut y));
        results.push(bits(&y));
    }
    assert!(results.windows(2).all(|pair| pair[0] == pair[1]));
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|value| value.to_bits()).collect()
}

#[test]
fn elementwise_functions_are_exact_to_a_few_units_in_the_last_place() {
    let grid: Vec<f32> = (-200_000..=200_000).map(|i| i as f32 * 5e-4).collect();
    for arch in arches() {
        let (mut sigmoids, mut tanhs, mut relus) = (grid.clone(), grid.clone(), grid.clone());
        arch.dispatch(Sigmoid(&mut sigmoids));
        arch.dispatch(Tanh(&mut tanhs));
        arch.dispatch(Relu(&mut relus));
        for (i, &x) in grid.iter().enumerate() {
            let sigmoid = 1.0 / (1.0 + (-x as f64).exp());
            // Below -87 the smallest values are all 1.6e-38.
            assert!(close(sigmoids[i], sigmoid), "{arch:?}: sigmoid({x}) = {}, not {sigmoid}", sigmoids[i]);
            let tanh = (x as f64).tanh();
            assert!(close(tanhs[i], tanh), "{arch:?}: tanh({x}) = {}, not {tanh}", tanhs[i]);
            assert_eq!(relus[i], x.max(0.0));
        }
    }

    fn close(found: f32, exact: f64) -> bool {
        (found as f64 - exact).abs() <= 4.0 * f32::EPSILON as f64 * exact.abs() + 2e-38
    }
}

#[test]
fn elementwise_functions_pass_on_nan_and_end_at_their_limits() {
    for arch in arches() {
        // Nineteen values reach full vectors and tails.
        let mut values = [f32::NAN; 19];
        arch.dispatch(Relu(&mut values));
        arch.dispatch(Sigmoid(&mut values));
        arch.dispatch(Tanh(&mut values));
        assert!(values.iter().all(|value| value.is_nan()), "{arch:?}");

        let mut limits = [f32::NEG_INFINITY, f32::MIN, f32::MAX, f32::INFINITY];
        arch.dispatch(Tanh(&mut limits));
        assert_eq!(limits, [-1.0, -1.0, 1.0, 1.0], "{arch:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn gates_are_those_of_pytorch(rows in 1usize..5, h in 1usize..40, seed in any::<u64>()) {
        let (input, recurrent) = (numbers(seed, rows * 4 * h, 4.0), numbers(seed ^ 1, rows * 3 * h, 4.0));
        let (hidden, cell) = (numbers(seed ^ 2, rows * h, 1.0), numbers(seed ^ 3, rows * h, 2.0));
        let bias = numbers(seed ^ 4, 4 * h, 1.0);
        let sigmoid = |x: f64| 1.0 / (1.0 + (-x).exp());
        for arch in arches() {
            let mut gru = hidden.clone();
            arch.dispatch(gates::Gru { h, input: &input[..rows * 3 * h], recurrent: &recurrent, hidden: &mut gru });
            let (mut lstm, mut lstm_cell) = (hidden.clone(), cell.clone());
            arch.dispatch(gates::Lstm { h, gates: &input, bias: &bias, hidden: &mut lstm, cell: &mut lstm_cell });
            for (row, j) in (0..rows).flat_map(|row| (0..h).map(move |j| (row, j))) {
                let at = row * h + j;
                let gate = |values: &[f32], gates: usize, gate: usize| values[row * gates * h + gate * h + j] as f64;
                let r = sigmoid(gate(&input, 3, 0) + gate(&recurrent, 3, 0));
                let z = sigmoid(gate(&input, 3, 1) + gate(&recurrent, 3, 1));
                let n = (gate(&input, 3, 2) + r * gate(&recurrent, 3, 2)).tanh();
                let expected = (1.0 - z) * n + z * hidden[at] as f64;
                prop_assert!((gru[at] as f64 - expected).abs() < 2e-6);

                let gate = |g: usize| gate(&input, 4, g) + bias[g * h + j] as f64;
                let expected = sigmoid(gate(1)) * cell[at] as f64 + sigmoid(gate(0)) * gate(2).tanh();
                prop_assert!((lstm_cell[at] as f64 - expected).abs() < 2e-6);
                prop_assert!((lstm[at] as f64 - sigmoid(gate(3)) * expected.tanh()).abs() < 2e-6);
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn gradients_are_the_product(rows in 0usize..40, k in 1usize..40, n in 1usize..300, seed in any::<u64>()) {
        let (x, d) = (numbers(seed, rows * k, 1.0), numbers(seed ^ 1, rows * n, 1.0));
        for arch in arches() {
            let mut found = numbers(seed ^ 2, k * n, 1.0);
            if let Some(op) = gradient::Gradient::new(rows, &x, &d, &mut found) {
                arch.dispatch(op);
            }
            for (i, j) in (0..k).flat_map(|i| (0..n).map(move |j| (i, j))) {
                let product: f64 =
                    (0..rows).map(|row| x[row * k + i] as f64 * d[row * n + j] as f64).sum();
                prop_assert!((found[i * n + j] as f64 - product).abs() < 1e-6 * (rows + 1) as f64);
            }
        }
    }

    #[test]
    fn transposed_twice_is_the_same(rows in 1usize..50, columns in 1usize..50, seed in any::<u64>()) {
        let x = numbers(seed, rows * columns, 1.0);
        let (mut once, mut twice) = (x.clone(), x.clone());
        transpose(rows, columns, &x, &mut once);
        prop_assert_eq!(once[(columns - 1) * rows], x[columns - 1]);
        transpose(columns, rows, &once, &mut twice);
        prop_assert_eq!(x, twice);
    }

    #[test]
    fn steps_that_can_be_taken_back_are_those_of_the_agents(
        rows in 1usize..5,
        h in 1usize..40,
        seed in any::<u64>(),
    ) {
        let (mut products, recurrent) = (numbers(seed, rows * 4 * h, 4.0), numbers(seed ^ 1, rows * 3 * h, 4.0));
        let (before, cell_before) = (numbers(seed ^ 2, rows * h, 1.0), numbers(seed ^ 3, rows * h, 2.0));
        let bias = numbers(seed ^ 4, 4 * h, 1.0);
        let (mut expected, mut found) = (before.clone(), before.clone());
        gru_gates(rows, &products[..rows * 3 * h], &recurrent, &mut expected);
        gru_forward(rows, &mut products.clone()[..rows * 3 * h], &recurrent, &before, &mut found);
        prop_assert_eq!(bits(&found), bits(&expected));

        let (mut expected_cell, mut found_cell) = (cell_before.clone(), cell_before.clone());
        lstm_gates(rows, &products, &bias, &mut expected, &mut expected_cell);
        lstm_forward(rows, &mut products, &bias, &cell_before, &mut found_cell, &mut found);
        prop_assert_eq!(bits(&found_cell), bits(&expected_cell));
        prop_assert_eq!(bits(&found), bits(&expected));
    }

    #[test]
    fn adam_is_that_of_pytorch(n in 1usize..70, steps in 1u64..5, seed in any::<u64>()) {
        let start = numbers(seed, n, 1.0);
        for arch in arches() {
            let (mut mean, mut square, mut values) = (vec![0.0; n], vec![0.0; n], start.clone());
            let (mut m, mut v) = (vec![0.0; n], vec![0.0; n]);
            let mut expected: Vec<f64> = start.iter().map(|&value| value as f64).collect();
            for number in 1..=steps {
                let gradient = numbers(seed ^ number, n, 3.0);
                let step = AdamStep::new(number, 1e-2, 0.5);
                arch.dispatch(adam::Adam {
                    step,
                    gradient: &gradient,
                    mean: &mut mean,
                    square: &mut square,
                    values: &mut values,
                });
                for at in 0..n {
                    let g = 0.5 * gradient[at] as f64;
                    m[at] = 0.9 * m[at] + 0.1 * g;
                    v[at] = 0.999 * v[at] + 0.001 * g * g;
                    let (m, v) = (m[at] / (1.0 - 0.9f64.powi(number as i32)), v[at] / (1.0 - 0.999f64.powi(number as i32)));
                    expected[at] -= 1e-2 * m / (v.sqrt() + 1e-8);
                }
            }
            for (found, expected) in values.iter().zip(&expected) {
                prop_assert!((*found as f64 - expected).abs() < 1e-6, "{arch:?}: {found}, not {expected}");
            }
        }
    }
}

#[test]
fn sums_over_many_values() {
    let values = numbers(3, 5000, 1.0);
    let exact: f64 = values.iter().map(|&value| (value as f64).powi(2)).sum();
    assert!((sum_of_squares(&values) / exact - 1.0).abs() < 1e-6);
    let mut sums = [7.0; 50];
    sum_rows(&values, &mut sums);
    for (column, sum) in sums.iter().enumerate() {
        let exact: f64 = values.iter().skip(column).step_by(50).map(|&value| value as f64).sum();
        assert!((*sum as f64 - exact).abs() < 1e-4);
    }
}

#[test]
fn a_derivative_passes_where_relu_does() {
    let mut y: Vec<f32> = (-20..20).map(|i| i as f32).collect();
    let mut d = vec![2.0; 40];
    relu(&mut y);
    relu_backward(&y, &mut d);
    assert!(d.iter().enumerate().all(|(i, &d)| d == if i > 20 { 2.0 } else { 0.0 }), "{d:?}");
}
