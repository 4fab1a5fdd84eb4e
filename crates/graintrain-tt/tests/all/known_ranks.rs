//! Exact ranks and closed forms from the literature and from singular values of every unfolding.

use crate::dense::{dense, full};
use graintrain_linalg::dense::{Lu, Matrix, product};
use graintrain_tt::qtt::{self, Boundary, DigitOrder};
use graintrain_tt::{Core, Truncation, TtMatrix, TtVector};

const TIGHT: f64 = 1e-10;

/// Inner ranks from the coarsest digit to the finest, as tables print them.
fn ranks_of(matrix: &Matrix) -> Vec<usize> {
    let d = matrix.rows().trailing_zeros() as usize;
    let (train, _) =
        TtMatrix::from_full(&full(matrix), &vec![2; d], &vec![2; d], &Truncation::to(TIGHT)).unwrap();
    coarse_to_fine(&train.ranks())
}

fn coarse_to_fine(ranks: &[usize]) -> Vec<usize> {
    let mut inner = ranks[1..ranks.len() - 1].to_vec();
    inner.reverse();
    inner
}

fn inverse(a: &Matrix) -> Matrix {
    let mut x = Matrix::identity(a.rows());
    Lu::new(a.clone()).unwrap().solve_in_place(x.view_mut());
    x
}

fn line(n: usize, first: f64, last: f64) -> Matrix {
    Matrix::from_fn(n, n, |i, j| match i.abs_diff(j) {
        0 if i == 0 => first,
        0 if i == n - 1 => last,
        0 => 2.0,
        1 => -1.0,
        _ => 0.0,
    })
}

fn band(n: usize, offset: isize, value: f64) -> Matrix {
    Matrix::from_fn(n, n, |i, j| if i as isize - j as isize == offset { value } else { 0.0 })
}

fn plus(a: &Matrix, b: &Matrix) -> Matrix {
    Matrix::from_fn(a.rows(), a.columns(), |i, j| a[(i, j)] + b[(i, j)])
}

#[test]
fn ranks_of_matrices_of_size_256() {
    let n = 256;
    let eye = Matrix::identity(n);
    let (dd, dn, nd, nn) = (line(n, 2.0, 2.0), line(n, 2.0, 1.0), line(n, 1.0, 2.0), line(n, 1.0, 1.0));
    let corners = Matrix::from_fn(n, n, |i, j| if i.abs_diff(j) == n - 1 { -1.0 } else { 0.0 });
    let periodic = plus(&dd, &corners);
    let shift = band(n, 1, 1.0);
    let periodic_shift = Matrix::from_fn(n, n, |i, j| f64::from((j + 1) % n == i));
    let general = plus(&plus(&band(n, 0, 2.3), &band(n, 1, -0.7)), &band(n, -1, -1.4));
    let five = plus(&general, &plus(&band(n, 2, 0.3), &band(n, -2, 0.11)));
    // pinv(NN) = (NN + 1 1^T / n)^-1 - 1 1^T / n
    let mean = Matrix::from_fn(n, n, |_, _| 1.0 / n as f64);
    let pinv = {
        let x = inverse(&plus(&nn, &mean));
        Matrix::from_fn(n, n, |i, j| x[(i, j)] - mean[(i, j)])
    };
    let dft = Matrix::from_fn(n, n, |i, j| (std::f64::consts::TAU * ((i * j) % n) as f64 / n as f64).cos());
    let full = vec![4, 5, 5, 5, 5, 5, 4];
    let cases = [
        ("identity", eye.clone(), vec![1; 7]),
        ("all ones", Matrix::from_fn(n, n, |_, _| 1.0), vec![1; 7]),
        ("shift", shift.clone(), vec![2; 7]),
        ("periodic shift", periodic_shift, vec![2; 7]),
        ("shift^3", band(n, 3, 1.0), vec![2; 7]),
        ("shift^5", band(n, 5, 1.0), vec![2; 7]),
        ("I - shift", plus(&eye, &band(n, 1, -1.0)), vec![2; 7]),
        ("lower triangle", Matrix::from_fn(n, n, |i, j| f64::from(i >= j)), vec![2; 7]),
        ("periodic Laplacian", periodic.clone(), vec![2, 3, 3, 3, 3, 3, 3]),
        ("(periodic + I)^-1", inverse(&plus(&periodic, &eye)), vec![2, 3, 3, 3, 3, 3, 3]),
        ("general tridiagonal", general.clone(), vec![3; 7]),
        ("five diagonals", five, vec![3; 7]),
        ("DD^2", product(dd.view(), dd.view()), full.clone()),
        ("DD", dd.clone(), vec![3; 7]),
        ("DN", dn.clone(), vec![4; 7]),
        ("ND", nd.clone(), vec![4; 7]),
        ("NN", nn.clone(), full.clone()),
        ("DD^-1", inverse(&dd), full.clone()),
        ("(DD + I)^-1", inverse(&plus(&dd, &eye)), full.clone()),
        ("(NN + I)^-1", inverse(&plus(&nn, &eye)), full.clone()),
        ("pinv(NN)", pinv, full.clone()),
        ("DN^-1", inverse(&dn), vec![4; 7]),
        ("ND^-1", inverse(&nd), vec![4; 7]),
        ("general tridiagonal^-1", inverse(&general), full),
        ("real part of the DFT", dft, vec![4, 16, 64, 227, 64, 16, 4]),
    ];
    for (name, matrix, expected) in cases {
        assert_eq!(ranks_of(&matrix), expected, "{name}");
    }
}

#[test]
fn explicit_constructions_equal_their_matrices() {
    for d in [2, 3, 6] {
        let n = 1 << d;
        let general = plus(&plus(&band(n, 0, 2.3), &band(n, 1, -0.7)), &band(n, -1, -1.4));
        let pairs = [
            (qtt::tridiagonal(d, -0.7, 2.3, -1.4).unwrap(), general),
            (qtt::laplacian(d).unwrap(), line(n, 2.0, 2.0)),
            (qtt::laplacian_with(d, Boundary::Neumann, Boundary::Dirichlet).unwrap(), line(n, 1.0, 2.0)),
            (qtt::laplacian_with(d, Boundary::Neumann, Boundary::Neumann).unwrap(), line(n, 1.0, 1.0)),
            (qtt::shift(d).unwrap(), band(n, 1, 1.0)),
            (qtt::periodic_shift(d).unwrap(), Matrix::from_fn(n, n, |i, j| f64::from((j + 1) % n == i))),
            (qtt::cumulative_sum(d).unwrap(), Matrix::from_fn(n, n, |i, j| f64::from(i >= j))),
            (qtt::hilbert_matrix(d, 1e-10).unwrap(), Matrix::from_fn(n, n, |i, j| 1.0 / (i + j + 1) as f64)),
        ];
        // (Of a + b J' + c J every entry is one product of numbers 0, 1 and one coefficient: exact.)
        for (k, (train, exact)) in pairs.iter().enumerate() {
            let full = train.to_full().unwrap();
            let worst = full.data().iter().zip(exact.data()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(worst <= if k < 7 { 0.0 } else { 1e-9 }, "construction {k}, d = {d}: {worst}");
            let rank = [3, 3, 4, 5, 2, 2, 2].get(k);
            assert!(
                rank.is_none_or(|&rank| train.ranks()[1..d].iter().all(|&r| r <= rank)),
                "{k}: {:?}",
                train.ranks()
            );
        }
        for (train, rank) in
            [(&pairs[0].0, 3), (&pairs[1].0, 3), (&pairs[4].0, 2), (&pairs[5].0, 2), (&pairs[6].0, 2)]
        {
            assert_eq!(train.ranks()[1..d], vec![rank; d - 1]);
        }
    }
    assert!(qtt::laplacian(1).is_err());
}

#[test]
fn the_line_has_rank_three_and_its_inverse_rank_five_also_at_two_to_the_twenty() {
    for d in [10, 20] {
        let a = qtt::laplacian(d).unwrap();
        let (rounded, report) = a.round(&Truncation::to(1e-13)).unwrap();
        assert_eq!(rounded.max_rank(), 3);
        assert!(report.error < 1e-13);
        // The inverse as an exact train: (A^-1)_ij = min(i, j) - i j / (n + 1), and min(i, j) = sum_k
        // [k <= i][k <= j] = (L L^T)_ij with L the lower triangle of ones; i j is of rank one in the pair and
        // of QTT rank 4.
        let sum = qtt::cumulative_sum(d).unwrap();
        let minimum = sum.times_matrix(&sum.transpose()).unwrap();
        let index = qtt::polynomial(d, &[1.0, 1.0], 0.0, 1.0).unwrap();
        let outer = outer_product(&index, &index).scale(-1.0 / ((1u64 << d) as f64 + 1.0));
        let exact = minimum.add(&outer).unwrap();
        let inverse = exact.round(&Truncation::to(1e-12)).unwrap().0;
        assert_eq!(inverse.max_rank(), 5, "d = {d}");
        let n = 1usize << d;
        for (i, j) in [(0, 0), (1, n - 1), (n / 2, n / 3), (n - 1, n - 1), (17, 5)] {
            let (low, high) = (i.min(j) as f64 + 1.0, i.max(j) as f64 + 1.0);
            let closed = low * (n as f64 + 1.0 - high) / (n as f64 + 1.0);
            assert!((inverse.entries(&[(i, j)]).unwrap()[0] - closed).abs() < 1e-8 * n as f64);
        }
        // A times its inverse is the identity, at the accuracy that cond(A) = 4^d / 2 leaves.
        if d == 10 {
            let identity = a.times_matrix(&inverse).unwrap();
            assert!(identity.relative_distance(&TtMatrix::identity(&[2; 10]).unwrap()).unwrap() < 1e-5);
        }
    }
}

/// x y^T with paired digits: the Kronecker product of the cores, digit by digit.
fn outer_product(x: &TtVector, y: &TtVector) -> TtMatrix {
    let d = x.num_cores();
    let column = |x: &TtVector| {
        let modes = x.modes();
        TtMatrix::from_vector(x.clone(), &modes, &vec![1; d]).unwrap()
    };
    column(x).times_matrix(&column(y).transpose()).unwrap()
}

#[test]
fn inverses_in_closed_form() {
    // Dirichlet at both ends: min(i, j) (n + 1 - max(i, j)) / (n + 1); times n + 1 all numbers are whole.
    let n = 256;
    let closed = Matrix::from_fn(n, n, |i, j| ((i.min(j) + 1) * (n - i.max(j))) as f64);
    let identity = product(line(n, 2.0, 2.0).view(), closed.view());
    let whole = |e: usize| if e.is_multiple_of(n + 1) { (n + 1) as f64 } else { 0.0 };
    assert!((0..n * n).all(|e| identity.data()[e] == whole(e)));
    // Dirichlet at the first end, Neumann at the last: min(i, j).
    let minimum = Matrix::from_fn(n, n, |i, j| (i.min(j) + 1) as f64);
    let identity = product(line(n, 2.0, 1.0).view(), minimum.view());
    let worst =
        (0..n * n).map(|e| (identity.data()[e] - f64::from(e % (n + 1) == 0)).abs()).fold(0.0, f64::max);
    assert_eq!(worst, 0.0);
    assert_eq!(ranks_of(&minimum), [4; 7]);
    // A band with l diagonals below and u above: the inverse has ranks of at most 1 + (l + u)^2.
    for (l, u, bound) in [(1, 1, 5), (1, 2, 10), (2, 2, 17)] {
        let banded = Matrix::from_fn(n, n, |i, j| match (i + u).wrapping_sub(j) {
            offset if offset > l + u => 0.0,
            offset if offset == u => 4.0,
            offset => -1.0 + 0.3 * offset as f64,
        });
        let ranks = ranks_of(&inverse(&banded));
        assert!(ranks.iter().all(|&rank| rank <= bound), "{l} {u}: {ranks:?}");
    }
    // A Toeplitz matrix from a train of ranks p has ranks of at most 2 p: here p = 2 (a sum of two
    // exponentials).
    let toeplitz = Matrix::from_fn(n, n, |i, j| {
        let k = (i + n - 1 - j) as f64 / n as f64;
        (-k).exp() + (2.0 * k).exp()
    });
    assert!(ranks_of(&toeplitz).iter().all(|&rank| rank <= 4));
}

#[test]
fn multidimensional_laplacians() {
    type Case = (Boundary, usize, usize, DigitOrder, Vec<usize>);
    let (d, n) = (Boundary::Dirichlet, Boundary::Neumann);
    let (separated, morton) = (DigitOrder::Separated, DigitOrder::Morton);
    let cases: [Case; 8] = [
        (d, 2, 5, separated, vec![3, 3, 3, 3, 2, 4, 4, 4, 3]),
        (d, 2, 5, morton, vec![3, 5, 5, 5, 5, 5, 5, 5, 3]),
        (n, 2, 5, separated, vec![4, 5, 5, 5, 2, 5, 6, 6, 4]),
        (n, 2, 5, morton, vec![4, 7, 8, 9, 9, 9, 9, 7, 4]),
        (d, 3, 3, separated, vec![3, 3, 2, 4, 4, 2, 4, 3]),
        (d, 3, 3, morton, vec![3, 5, 7, 7, 7, 7, 5, 3]),
        (n, 3, 3, separated, vec![4, 5, 2, 5, 5, 2, 5, 4]),
        (n, 3, 3, morton, vec![4, 7, 10, 11, 11, 10, 7, 4]),
    ];
    for (boundary, dimension, levels, order, expected) in cases {
        let line = qtt::laplacian_with(levels, boundary, boundary).unwrap();
        let a = qtt::kronecker_sum(&vec![line; dimension], order).unwrap();
        let a = a.round(&Truncation::to(TIGHT)).unwrap().0;
        let found = coarse_to_fine(&a.ranks());
        // The table prints the coarsest digit of the first axis first; axes are exchangeable in separated
        // order.
        assert_eq!(found, expected, "{boundary:?} {dimension}-D {order:?}");
    }
    // The train of TT-Toolbox's tt_qlaplace_dd([4 4]) has ranks 1 4 4 4 2 3 3 3 1, one bond above the
    // numerical rank: ours is rounded and has the 3 there, and is the same matrix.
    let line = qtt::laplacian(4).unwrap();
    let plane = qtt::kronecker_sum(&[line.clone(), line], separated).unwrap();
    assert_eq!(plane.ranks(), [1, 3, 4, 4, 2, 3, 3, 3, 1]);
    let explicit = explicit_plane();
    assert_eq!(explicit.ranks(), [1, 4, 4, 4, 2, 3, 3, 3, 1]);
    assert!(
        plane.relative_distance(&explicit).unwrap() < 1e-13,
        "{}",
        plane.relative_distance(&explicit).unwrap()
    );
    assert_eq!(explicit.round(&Truncation::to(1e-13)).unwrap().0.ranks(), plane.ranks());
    // 2^30 unknowns.
    let line = qtt::laplacian(10).unwrap();
    let cube = qtt::kronecker_sum(&[line.clone(), line.clone(), line], morton).unwrap();
    assert_eq!(cube.max_rank(), 7);
}

/// L (x) I + I (x) L for the line L of 2^4 points from the factors of Kazeev and Khoromskij, fine to coarse:
/// along the first axis beside the three states of L a fourth that carries I, along the second one the state
/// of I is the first of L.
fn explicit_plane() -> TtMatrix {
    let identity = [1.0, 0.0, 0.0, 1.0];
    let (up, down, zero) = ([0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0; 4]);
    let last = [[2.0, -1.0, -1.0, 2.0], up.map(|x| -x), down.map(|x| -x)];
    let middle = [[identity, down, up], [zero, up, zero], [zero, zero, down]];
    let first = middle[0];
    // (Column-major 2 x 2 blocks by left and right state; the table of the paper runs from coarse to fine.)
    let core = |left: usize, right: usize, block: &dyn Fn(usize, usize) -> [f64; 4]| {
        Core::from_fn(left, 4, right, |alpha, b, beta| block(alpha, beta)[b])
    };
    let other = |flag: bool| if flag { identity } else { zero };
    let inner = |alpha: usize, beta: usize| {
        if alpha == 3 || beta == 3 { other(alpha == beta) } else { middle[beta][alpha] }
    };
    let seam = |alpha: usize, beta: usize| match (alpha, beta) {
        (3, beta) => other(beta == 1),
        (alpha, 0) => first[alpha],
        _ => zero,
    };
    let start = |alpha: usize, beta: usize| if alpha == 1 { last[beta] } else { other(beta == 0) };
    let cores = vec![
        core(1, 4, &|_, beta| if beta == 3 { identity } else { last[beta] }),
        core(4, 4, &inner),
        core(4, 4, &inner),
        core(4, 2, &seam),
        core(2, 3, &start),
        core(3, 3, &inner),
        core(3, 3, &inner),
        core(3, 1, &|alpha, _| first[alpha]),
    ];
    TtMatrix::from_cores(cores, &[2; 8], &[2; 8]).unwrap()
}

/// The rank of every unfolding at a relative error `tolerance`, coarsest digit first.
fn unfolding_ranks(train: &TtVector, tolerance: f64) -> Vec<usize> {
    let rank = |s: &Vec<f64>| {
        let total: f64 = s.iter().map(|s| s * s).sum();
        let (mut rank, mut tail) = (s.len(), 0.0);
        while rank > 0 && tail + s[rank - 1].powi(2) <= tolerance.powi(2) * total {
            tail += s[rank - 1].powi(2);
            rank -= 1;
        }
        rank
    };
    train.singular_values().unwrap().iter().rev().map(rank).collect()
}

#[test]
fn inverse_of_the_morton_plane_needs_more_rank_than_the_separated_one() {
    let cases = [
        (2, 5, DigitOrder::Separated, [10, 20, 29, 36]),
        (2, 5, DigitOrder::Morton, [26, 60, 92, 118]),
        (2, 4, DigitOrder::Separated, [9, 17, 23, 28]),
        (2, 4, DigitOrder::Morton, [23, 53, 75, 81]),
        (3, 3, DigitOrder::Separated, [8, 17, 23, 27]),
        (3, 3, DigitOrder::Morton, [56, 150, 192, 192]),
    ];
    for (dimension, levels, order, expected) in cases {
        let line = qtt::laplacian(levels).unwrap();
        let a = qtt::kronecker_sum(&vec![line; dimension], order).unwrap();
        let sizes = a.row_modes().to_vec();
        let x = inverse(&dense(&a));
        let exact = TtMatrix::from_full(&full(&x), &sizes, &sizes, &Truncation::to(1e-11)).unwrap().0;
        for (tolerance, expected) in [1e-2, 1e-4, 1e-6, 1e-8].into_iter().zip(expected) {
            let found = unfolding_ranks(exact.as_vector(), tolerance).into_iter().max().unwrap();
            assert_eq!(found, expected, "{dimension}-D {order:?} {tolerance}");
        }
    }
}

#[test]
fn ranks_of_functions_on_256_points() {
    let n = 256usize;
    let grid = |f: &dyn Fn(f64) -> f64| (0..n).map(|i| f(i as f64 / n as f64)).collect::<Vec<f64>>();
    let cases: Vec<(&str, Vec<f64>, f64, Vec<usize>)> = vec![
        ("exp", grid(&|x| x.exp()), TIGHT, vec![1; 7]),
        ("sin", grid(&|x| (7.0 * x + 0.3).sin()), TIGHT, vec![2; 7]),
        ("cos", grid(&|x| (7.0 * x + 0.3).cos()), TIGHT, vec![2; 7]),
        ("exp sin", grid(&|x| x.exp() * (7.0 * x).sin()), TIGHT, vec![2; 7]),
        ("x", grid(&|x| x), TIGHT, vec![2; 7]),
        ("x^2", grid(&|x| x * x), TIGHT, vec![2, 3, 3, 3, 3, 3, 2]),
        ("x^3", grid(&|x| x.powi(3)), TIGHT, vec![2, 4, 4, 4, 4, 4, 2]),
        (
            "three exponentials",
            grid(&|x| x.exp() + (-3.0 * x).exp() + (5.0 * x).exp()),
            TIGHT,
            vec![2, 3, 3, 3, 3, 3, 2],
        ),
        ("step", (0..n).map(|i| f64::from(i >= 85)).collect(), TIGHT, vec![2; 7]),
        ("delta", (0..n).map(|i| f64::from(i == 77)).collect(), TIGHT, vec![1; 7]),
        ("reciprocal", grid(&|x| 1.0 / (1.0 + x)), TIGHT, vec![2, 4, 5, 4, 4, 3, 2]),
        ("gaussian", grid(&|x| (-20.0 * (x - 0.5).powi(2)).exp()), 1e-6, vec![2, 4, 6, 5, 4, 4, 2]),
        ("root", grid(&|x| x.sqrt()), 1e-6, vec![2, 4, 5, 5, 5, 4, 2]),
    ];
    for (name, values, tolerance, expected) in cases {
        let train = TtVector::from_full(&values, &[2; 8], &Truncation::to(1e-14)).unwrap().0;
        assert_eq!(unfolding_ranks(&train, tolerance), expected, "{name}");
    }
}

#[test]
fn function_trains_are_their_functions_up_to_two_to_the_forty_points() {
    for d in [8, 40] {
        let trains = [
            (
                qtt::exponential(d, 0.7e-11, 0.2).unwrap(),
                (|j| (0.7e-11 * j + 0.2f64).exp()) as fn(f64) -> f64,
                1,
            ),
            (qtt::sine(d, 0.3e-10, 0.2).unwrap(), |j| (0.3e-10 * j + 0.2f64).sin(), 2),
            (
                qtt::polynomial(d, &[1.0, -2.0, 0.5], 0.1, 1e-12).unwrap(),
                |j| {
                    let x = 0.1 + 1e-12 * j;
                    1.0 - 2.0 * x + 0.5 * x * x
                },
                3,
            ),
        ];
        for (train, function, rank) in trains {
            assert!(train.max_rank() <= rank);
            for k in 0..60u64 {
                let j = k.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> (64 - d);
                let digits: Vec<usize> = (0..d).map(|b| (j >> b & 1) as usize).collect();
                let value = train.entry(&digits).unwrap();
                assert!((value - function(j as f64)).abs() < 1e-8, "d = {d}, j = {j}: {value}");
            }
        }
    }
}

#[test]
fn hilbert_tensors_have_the_ranks_of_the_table() {
    // 1 / (i_1 + ... + i_D), 1-based, n = 32.
    let table = [
        (3, 1e-4, vec![5, 5]),
        (3, 1e-8, vec![9, 9]),
        (3, 1e-12, vec![13, 13]),
        (4, 1e-4, vec![5, 5, 5]),
        (4, 1e-8, vec![9, 10, 9]),
        (4, 1e-12, vec![13, 14, 13]),
    ];
    for (dimension, tolerance, expected) in table {
        let modes = vec![32; dimension];
        let full: Vec<f64> = (0..32usize.pow(dimension as u32))
            .map(|mut j| {
                let mut sum = dimension;
                for _ in 0..dimension {
                    sum += j % 32;
                    j /= 32;
                }
                1.0 / sum as f64
            })
            .collect();
        let train = TtVector::from_full(&full, &modes, &Truncation::to(1e-14)).unwrap().0;
        // TT-SVD allows tolerance / sqrt(d - 1) per bond.
        let found = unfolding_ranks(&train, tolerance / ((dimension - 1) as f64).sqrt());
        assert_eq!(found, expected, "{dimension} {tolerance}");
        if dimension == 3 {
            let explicit = qtt::hilbert(&modes, 3.0, 1e-9).unwrap();
            let exact = TtVector::from_full(&full, &modes, &Truncation::to(1e-14)).unwrap().0;
            assert!(explicit.relative_distance(&exact).unwrap() < 1e-9);
        }
    }
}
