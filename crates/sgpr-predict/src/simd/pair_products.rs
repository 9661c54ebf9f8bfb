//! Products of numbers of 16 bits, two at a time.

#[cfg(target_arch = "x86_64")]
use std::any::Any;

use bytemuck::cast;
use pulp::Simd;
#[cfg(target_arch = "x86_64")]
use pulp::x86::{V3, V4};

/// Two numbers of 16 bits in a word.
pub fn pair(numbers: [i16; 2]) -> u32 {
    cast(numbers)
}

/// For every word a₀ b₀ + a₁ b₁, with the instruction where there is one.
#[inline(always)]
pub fn pair_products<S: Simd>(simd: S, a: S::u32s, b: S::u32s) -> S::u32s {
    #[cfg(target_arch = "x86_64")]
    if let Some(simd) = (&simd as &dyn Any).downcast_ref::<V4>() {
        return cast(simd.multiply_wrapping_add_adjacent_i16x32(cast(a), cast(b)));
    } else if let Some(simd) = (&simd as &dyn Any).downcast_ref::<V3>() {
        return cast(simd.multiply_wrapping_add_adjacent_i16x16(cast(a), cast(b)));
    }
    let mut products = simd.splat_u32s(0);
    let numbers =
        |register| bytemuck::cast_slice::<S::u32s, [i16; 2]>(std::slice::from_ref(register));
    let words = bytemuck::cast_slice_mut::<S::u32s, i32>(std::slice::from_mut(&mut products));
    for ((product, a), b) in words.iter_mut().zip(numbers(&a)).zip(numbers(&b)) {
        let [first, second] = [0, 1].map(|k| i32::from(a[k]) * i32::from(b[k]));
        *product = first.wrapping_add(second);
    }
    products
}

#[cfg(test)]
mod tests {
    use super::*;
    use pulp::{Arch, Scalar, WithSimd};

    struct Products<'a>(&'a [u32], &'a [u32]);

    impl WithSimd for Products<'_> {
        type Output = Vec<i32>;

        fn with_simd<S: Simd>(self, simd: S) -> Vec<i32> {
            let registers = S::as_simd_u32s(self.0).0.iter().zip(S::as_simd_u32s(self.1).0);
            let products: Vec<S::u32s> =
                registers.map(|(a, b)| pair_products(simd, *a, *b)).collect();
            bytemuck::cast_slice(&products).to_vec()
        }
    }

    #[test]
    fn every_instruction_set_gives_the_same_products() {
        let numbers = |seed: i16| -> Vec<[i16; 2]> {
            let next = |k: i16| k.wrapping_mul(seed).wrapping_add(i16::MAX);
            (0..64).map(|k| [next(k), next(k + 64)]).collect()
        };
        let (a, b) = (numbers(31_337), numbers(7_919));
        let words =
            |numbers: &[[i16; 2]]| -> Vec<u32> { numbers.iter().map(|n| pair(*n)).collect() };
        let (a_words, b_words) = (words(&a), words(&b));
        let product = |(a, b): (&[i16; 2], &[i16; 2])| {
            (0..2).map(|k| i32::from(a[k]) * i32::from(b[k])).sum()
        };
        let expected: Vec<i32> = a.iter().zip(&b).map(product).collect();
        assert_eq!(Scalar::new().vectorize(Products(&a_words, &b_words)), expected);
        assert_eq!(Arch::new().dispatch(Products(&a_words, &b_words)), expected);
        #[cfg(target_arch = "x86_64")]
        if let Some(simd) = V3::try_new() {
            assert_eq!(Simd::vectorize(simd, Products(&a_words, &b_words)), expected);
        }
    }
}
