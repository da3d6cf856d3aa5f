use nalgebra::{DMatrix, SMatrix};

use super::super::rows::{
    add_squares, append_combined, pass_rows, pull_rows, times_symmetric, turn_blocks,
};
use super::*;
use crate::covariance::fast::arithmetic::{Arithmetic, Plain, Row};

fn matrix<const R: usize, const C: usize>(seed: f64) -> Matrix<f64, R, C> {
    std::array::from_fn(|i| std::array::from_fn(|j| libm::sin(seed + (C * i + j) as f64 * 1.7)))
}

fn dense<const R: usize, const C: usize>(a: &Matrix<f64, R, C>) -> SMatrix<f64, R, C> {
    SMatrix::from_fn(|i, j| a[i][j])
}

type Quad = <Plain as Arithmetic>::Quad;

fn rows(count: usize, width: usize, seed: f64) -> Vec<Quad> {
    let quad = |i: usize| [0, 1, 2, 3].map(|e| libm::cos(seed + (4 * i + e) as f64 * 0.9));
    (0..count * width).map(|i| Plain.quad(quad(i))).collect()
}

fn of_rows(rows: &[Quad], width: usize) -> DMatrix<f64> {
    DMatrix::from_fn(rows.len() / width, 4 * width, |i, j| {
        rows[i * width + j / 4].get(j % 4)
    })
}

#[test]
fn products_are_those_of_matrices() {
    let (a, b) = (matrix::<6, 9>(0.3), matrix::<9, 4>(0.9));
    let expected = dense(&a) * dense(&b);
    assert!((dense(&product(Plain, &a, &b)) - expected).amax() < 1e-14);
    assert!((dense(&transposed_product(Plain, &transpose(&a), &b)) - expected).amax() < 1e-14);
    assert!((dense(&product_transposed(Plain, &a, &transpose(&b))) - expected).amax() < 1e-14);
    assert!((dense(&square(&a)) - dense(&a) * dense(&a).transpose()).amax() < 1e-14);
}

#[test]
fn transitions_and_turns_are_those_of_matrices() {
    const S: usize = 9;
    let (top, p) = (matrix::<3, S>(0.2), square(&matrix::<S, S>(0.8)));
    let kept: [f64; S] = std::array::from_fn(|i| libm::cos(i as f64));
    let t = SMatrix::<f64, S, S>::from_fn(|i, j| match i < 3 {
        true => top[i][j],
        false => f64::from(u8::from(i == j)) * kept[i],
    });
    let close = |found: &Matrix<f64, S, S>, expected: SMatrix<f64, S, S>| {
        assert!((dense(found) - expected).amax() < 1e-12);
        assert_eq!(*found, transpose(found));
    };
    let p_dense = dense(&p);
    close(
        &pass_covariance(Plain, &top, &kept, &p),
        t * p_dense * t.transpose(),
    );
    close(
        &pull_covariance(Plain, &top, &kept, &p),
        t.transpose() * p_dense * t,
    );
    assert!((dense(&times_passed(&p, &top, &kept)) - p_dense * t).amax() < 1e-13);
    let q = matrix::<3, 3>(0.6);
    let turned = SMatrix::<f64, S, S>::from_fn(|i, j| match (i / 3, j / 3) {
        (0, 0) => f64::from(u8::from(i == j)),
        (a, b) if a == b => q[i % 3][j % 3],
        _ => 0.0,
    });
    close(
        &turn_covariance(Plain, &q, 3, &p),
        turned * p_dense * turned.transpose(),
    );
    let width = 2;
    let v = rows(S, width, 0.3);
    let of = |m: SMatrix<f64, S, S>, found: &[Quad]| {
        let expected = DMatrix::from_fn(S, S, |i, j| m[(i, j)]) * of_rows(&v, width);
        assert!((of_rows(found, width) - expected).amax() < 1e-13);
    };
    let (mut passed, mut pulled, mut by_blocks) = (v.clone(), v.clone(), v.clone());
    pass_rows(&top, &kept, &mut passed, width);
    of(t, &passed);
    pull_rows(&top, &kept, &mut pulled, width);
    of(t.transpose(), &pulled);
    turn_blocks::<_, S>(&q, 3, &mut by_blocks, width);
    of(turned, &by_blocks);
}

#[test]
fn roots_and_whiteners() {
    fn check<const R: usize>() {
        let m = square(&matrix::<R, R>(0.7));
        let g = dense(&square_root(&m));
        assert!((g * g.transpose() - dense(&m)).amax() < 1e-12);
        let w = dense(&whitener(Plain, &m));
        let one = SMatrix::<f64, R, R>::identity();
        assert!((w * (dense(&m) + one) * w.transpose() - one).amax() < 1e-12);
        let mut more = m;
        for i in 0..R {
            more[i][i] += 0.1;
        }
        let w = dense(&inverse_root(&more));
        assert!((w * dense(&more) * w.transpose() - one).amax() < 1e-11);
    }
    check::<1>();
    check::<3>();
    check::<9>();
    // Nothing is known of the second direction but that it is zero.
    assert_eq!(
        square_root(&[[4.0, 0.0], [0.0, 0.0]]),
        [[2.0, 0.0], [0.0, 0.0]]
    );
}

#[test]
fn rows_are_combined_summed_and_squared() {
    let width = 3;
    let (v, w) = (rows(3, width, 0.2), rows(6, width, 1.1));
    let (m, n) = (matrix::<3, 3>(0.4), matrix::<3, 6>(0.5));
    let (dense_v, dense_w) = (of_rows(&v, width), of_rows(&w, width));
    let dynamic = |m: &[&[f64]]| DMatrix::from_fn(m.len(), m[0].len(), |i, j| m[i][j]);
    let (dense_m, dense_n) = (
        dynamic(&m.each_ref().map(|r| &r[..])),
        dynamic(&n.each_ref().map(|r| &r[..])),
    );
    let mut out = Vec::new();
    append_combined(&mut out, (&m, &v), (&n, &w), width);
    let expected = &dense_m * &dense_v + &dense_n * &dense_w;
    assert!((of_rows(&out, width) - &expected).amax() < 1e-13);
    let mut turned = v.clone();
    turn_rows(Plain, &m, &mut turned, width);
    add_combined(Plain, &mut turned, &n, &w, width);
    assert!((of_rows(&turned, width) - expected).amax() < 1e-13);
    let found = dots::<_, 3, 6>(Plain, &v, &w, width);
    let expected = &dense_v * dense_w.transpose();
    assert!((dynamic(&found.each_ref().map(|r| &r[..])) - expected).amax() < 1e-13);
    for count in [1, 4, 6] {
        let weights: Vec<f64> = (0..count).map(|r| 0.5 + r as f64).collect();
        let mut e = vec![Plain.quad([0.0; 4]); 4 * width * width];
        add_squares(&mut e, &w[..count * width], &weights, width);
        let x = of_rows(&w[..count * width], width);
        let expected = x.transpose() * DMatrix::from_diagonal(&weights.into()) * &x;
        let found = of_rows(&e, width);
        for i in 0..4 * width {
            for j in i..4 * width {
                assert!((found[(i, j)] - expected[(i, j)]).abs() < 1e-13);
            }
        }
    }
    let symmetric = rows(4 * width, width, 0.6);
    let found = times_symmetric(&v, &symmetric, width);
    let expected = dense_v * of_rows(&symmetric, width);
    assert!((of_rows(&found, width) - expected).amax() < 1e-13);
}
