//! Eight numbers that go together through a loop.
//!
//! The compiler makes vector instructions of whatever width the machine has out of them; the digits are the same with all, because
//! every lane is computed by itself and sums are taken lane by lane.

use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

use bytemuck::{Pod, Zeroable};
use pulp::{Arch, NullaryFnOnce};

/// Numbers in [`Lanes`].
pub(super) const LANES: usize = 8;

/// A loop over lanes, run with the widest instructions that the machine has: its body must be `inline(always)`, as
/// must all that it calls.
pub(super) fn run<L: NullaryFnOnce>(body: L) -> L::Output {
    Arch::new().dispatch(body)
}

/// Eight numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C, align(32))]
pub(super) struct Lanes(pub(super) [f32; LANES]);

impl Lanes {
    pub(super) const ZERO: Self = Self([0.0; LANES]);
    pub(super) const ONE: Self = Self([1.0; LANES]);

    #[inline(always)]
    pub(super) const fn splat(number: f32) -> Self {
        Self([number; LANES])
    }

    #[inline(always)]
    pub(super) fn map(self, of: impl Fn(f32) -> f32) -> Self {
        let mut numbers = self.0;
        for number in &mut numbers {
            *number = of(*number);
        }
        Self(numbers)
    }

    #[inline(always)]
    pub(super) fn zip(self, other: Self, of: impl Fn(f32, f32) -> f32) -> Self {
        let mut numbers = self.0;
        for (number, other) in numbers.iter_mut().zip(other.0) {
            *number = of(*number, other);
        }
        Self(numbers)
    }

    #[inline(always)]
    pub(super) fn sqrt(self) -> Self {
        self.map(f32::sqrt)
    }

    /// Sum in double precision, by halves: always in the same order.
    #[inline(always)]
    pub(super) fn sum(self) -> f64 {
        const HALF: usize = LANES / 2;
        let mut sums = [0.0; HALF];
        for (lane, sum) in sums.iter_mut().enumerate() {
            *sum = f64::from(self.0[lane]) + f64::from(self.0[lane + HALF]);
        }
        (sums[0] + sums[2]) + (sums[1] + sums[3])
    }
}

impl Add for Lanes {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
}

impl Sub for Lanes {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }
}

impl Mul for Lanes {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
}

impl Div for Lanes {
    type Output = Self;

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.zip(other, |a, b| a / b)
    }
}

impl AddAssign for Lanes {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl SubAssign for Lanes {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl MulAssign for Lanes {
    #[inline(always)]
    fn mul_assign(&mut self, other: Self) {
        *self = *self * other;
    }
}

impl Neg for Lanes {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        self.map(|a| -a)
    }
}

/// Sums of the products of columns with others of the same length.
pub(super) fn sums_of_products<const OWN: usize, const OTHERS: usize>(
    own: [&[Lanes]; OWN],
    others: [&[Lanes]; OTHERS],
) -> [[f64; OTHERS]; OWN] {
    run(SumsOfProducts { own, others })
}

struct SumsOfProducts<'a, const OWN: usize, const OTHERS: usize> {
    own: [&'a [Lanes]; OWN],
    others: [&'a [Lanes]; OTHERS],
}

impl<const OWN: usize, const OTHERS: usize> NullaryFnOnce for SumsOfProducts<'_, OWN, OTHERS> {
    type Output = [[f64; OTHERS]; OWN];

    #[inline(always)]
    fn call(self) -> Self::Output {
        // Loops throughout: what an array maps with is not put into this function.
        let count = self.own[0].len();
        let (mut own, mut others) = (self.own, self.others);
        for column in own.iter_mut().chain(&mut others) {
            *column = &column[..count];
        }
        let mut lanes = [[Lanes::ZERO; OTHERS]; OWN];
        for lane in 0..count {
            for (sums, own) in lanes.iter_mut().zip(&own) {
                for (sum, other) in sums.iter_mut().zip(&others) {
                    *sum += own[lane] * other[lane];
                }
            }
        }
        let mut sums = [[0.0; OTHERS]; OWN];
        for (sums, lanes) in sums.iter_mut().zip(&lanes) {
            for (sum, lanes) in sums.iter_mut().zip(lanes) {
                *sum = lanes.sum();
            }
        }
        sums
    }
}
