//! Sine and cosine in lanes.
//!
//! The argument is reduced by multiples of π/2 in three parts (Cody & Waite; the parts and the
//! polynomials are those of fdlibm's `k_sin`, `k_cos`, `rem_pio2`), so the error stays within
//! about one unit in the last place up to |x| of some 1e5; no angle or Earth rotation of a test
//! comes near that.

use super::arithmetic::Number;

/// π/2 in parts of 33 bits.
const HALF_PI: [f64; 3] = [
    1.570_796_326_734_125_6,
    6.077_100_506_303_966e-11,
    2.022_266_248_795_950_6e-21,
];
/// Adding and subtracting it rounds to a whole number.
const ROUNDING: f64 = 1.5 * (1u64 << 52) as f64;

const SIN: [f64; 6] = [
    -1.666_666_666_666_663_2e-1,
    8.333_333_333_322_49e-3,
    -1.984_126_982_985_795e-4,
    2.755_731_370_707_007e-6,
    -2.505_076_025_340_686_4e-8,
    1.589_690_995_211_55e-10,
];
const COS: [f64; 6] = [
    4.166_666_666_666_66e-2,
    -1.388_888_888_887_411e-3,
    2.480_158_728_947_673e-5,
    -2.755_731_435_139_066_5e-7,
    2.087_572_321_298_175e-9,
    -1.135_964_755_778_819_5e-11,
];

#[inline(always)]
fn polynomial<N: Number>(x: N, c: &[f64; 6]) -> N {
    // Two halves side by side: a shorter chain than Horner's.
    let x2 = x * x;
    let low = x.mul_add(x.constant(c[1]), x.constant(c[0]));
    let low = x2.mul_add(x.constant(c[2]), low);
    let high = x.mul_add(x.constant(c[4]), x.constant(c[3]));
    let high = x2.mul_add(x.constant(c[5]), high);
    (x2 * x).mul_add(high, low)
}

/// (sin x, cos x).
#[inline(always)]
pub(crate) fn sin_cos<N: Number>(x: N) -> (N, N) {
    let (zero, one, two) = (x.constant(0.0), x.constant(1.0), x.constant(2.0));
    let rounding = x.constant(ROUNDING);
    let turns = x.mul_add(x.constant(std::f64::consts::FRAC_2_PI), rounding) - rounding;
    let r = turns.mul_add(x.constant(-HALF_PI[0]), x);
    let r = turns.mul_add(x.constant(-HALF_PI[1]), r);
    let r = turns.mul_add(x.constant(-HALF_PI[2]), r);
    let r2 = r * r;
    let sin = (r2 * r).mul_add(polynomial(r2, &SIN), r);
    let half = x.constant(0.5);
    let cos = (r2 * r2).mul_add(polynomial(r2, &COS), one - half * r2);
    // The quarter turn, −2 to 2: odd ones swap sine and cosine.
    let quarter = x.constant(0.25);
    let quarters = turns - x.constant(4.0) * (turns.mul_add(quarter, rounding) - rounding);
    let size = quarters.where_greater(quarters, zero, -quarters);
    let odd = one - (size - one) * (size - one);
    let s = cos.where_greater(odd, half, sin);
    let c = sin.where_greater(odd, half, cos);
    // sin is negative in the half turns −1, ±2; cos in 1, ±2.
    let back = two - half;
    let s = (-s).where_greater(size, back, (-s).where_greater(-half, quarters, s));
    let c = (-c).where_greater(size, back, (-c).where_greater(quarters, half, c));
    (s, c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_and_cosine_are_right_in_the_last_place() {
        let mut x = -700.0;
        while x < 700.0 {
            let (s, c) = sin_cos(x);
            let (s0, c0) = f64::sin_cos(x);
            assert!(
                (s - s0).abs() <= 2.3e-16 && (c - c0).abs() <= 2.3e-16,
                "{x}"
            );
            x += 0.0137;
        }
        for x in [0.0, 1e-9, -1e-12, 1e-300] {
            assert_eq!(sin_cos(x), (x, 1.0));
        }
        for quarter in -9..=9 {
            let x = f64::from(quarter) * std::f64::consts::FRAC_PI_2;
            let (s, c) = sin_cos(x);
            assert!((s - x.sin()).abs() < 1e-16 && (c - x.cos()).abs() < 1e-16);
        }
    }
}
