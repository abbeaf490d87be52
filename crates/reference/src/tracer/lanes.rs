//! Eight `f32` lanes, once for any processor and once for AVX2.
//!
//! The traversal is written once over [`Lanes`]; both implementations round every operation as IEEE
//! 754 prescribes, so that they give the same answers to the last bit.

/// Eight `f32` values that are computed with at once.
pub(super) trait Lanes: Copy {
    fn load(values: &[f32; 8]) -> Self;
    fn splat(value: f32) -> Self;
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
    /// `self * factor + summand`, rounded once.
    fn mul_add(self, factor: Self, summand: Self) -> Self;
    /// `summand - self * factor`, rounded once.
    fn neg_mul_add(self, factor: Self, summand: Self) -> Self;
    /// The smaller value; `other` where one is not a number.
    fn min(self, other: Self) -> Self;
    /// The larger value; `other` where one is not a number.
    fn max(self, other: Self) -> Self;
    fn abs(self) -> Self;
    /// Bit i is set where lane i of `self` is at most that of `other`; never for a NaN.
    fn le(self, other: Self) -> u32;
    /// Bit i is set where lane i of `self` is below that of `other`; never for a NaN.
    fn lt(self, other: Self) -> u32;
    /// `self`, negated where `other` has its sign bit set.
    fn flip(self, other: Self) -> Self;
    /// Writes the values at the set bits of `mask` to the front of `out`; the rest of `out` is
    /// left with arbitrary ones of them.
    fn compress(values: &[u32; 8], mask: u32, out: &mut [u32; 8]);
}

/// Eight lanes in plain Rust.
#[derive(Clone, Copy)]
pub(super) struct Portable([f32; 8]);

impl Portable {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(std::array::from_fn(|i| f(self.0[i], other.0[i])))
    }
}

impl Lanes for Portable {
    #[inline(always)]
    fn load(values: &[f32; 8]) -> Self {
        Self(*values)
    }
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self([value; 8])
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, summand: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i].mul_add(factor.0[i], summand.0[i])))
    }
    #[inline(always)]
    fn neg_mul_add(self, factor: Self, summand: Self) -> Self {
        Self(std::array::from_fn(|i| (-self.0[i]).mul_add(factor.0[i], summand.0[i])))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.map(f32::abs))
    }
    #[inline(always)]
    fn le(self, other: Self) -> u32 {
        (0..8).fold(0, |mask, i| mask | (u32::from(self.0[i] <= other.0[i]) << i))
    }
    #[inline(always)]
    fn lt(self, other: Self) -> u32 {
        (0..8).fold(0, |mask, i| mask | (u32::from(self.0[i] < other.0[i]) << i))
    }
    #[inline(always)]
    fn flip(self, other: Self) -> Self {
        self.zip(other, |a, b| if b.is_sign_negative() { -a } else { a })
    }
    #[inline(always)]
    fn compress(values: &[u32; 8], mask: u32, out: &mut [u32; 8]) {
        let mut count = 0;
        for (i, &value) in values.iter().enumerate() {
            if mask >> i & 1 == 1 {
                out[count] = value;
                count += 1;
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) use avx2::Avx2;

/// Every method here is a thin wrapper of AVX2 and FMA instructions. [`Avx2`] may be used only where
/// both were detected: it is private to the tracer, whose entries with these features enabled
/// (`Tracer::traverse`, `Tracer::occluded_each`) check that. With AVX-512 enabled too, the compiler
/// has 32 registers for the same instructions.
#[cfg(target_arch = "x86_64")]
mod avx2 {
    use std::arch::x86_64::*;

    use super::Lanes;

    /// Eight lanes in an AVX2 register.
    #[derive(Clone, Copy)]
    pub(in super::super) struct Avx2(__m256);

    /// For each mask the positions of its set bits, in order, a byte each.
    static POSITIONS: [u64; 256] = {
        let mut table = [0; 256];
        let mut mask = 0;
        while mask < 256 {
            let (mut bit, mut count) = (0, 0);
            while bit < 8 {
                if mask >> bit & 1 == 1 {
                    table[mask] |= bit << (8 * count);
                    count += 1;
                }
                bit += 1;
            }
            mask += 1;
        }
        table
    };

    impl Lanes for Avx2 {
        #[inline(always)]
        fn load(values: &[f32; 8]) -> Self {
            // SAFETY: AVX2 is present (module comment); the pointer is to eight f32, any alignment.
            Self(unsafe { _mm256_loadu_ps(values.as_ptr()) })
        }
        #[inline(always)]
        fn splat(value: f32) -> Self {
            // SAFETY: AVX2 is present (module comment).
            Self(unsafe { _mm256_set1_ps(value) })
        }
        #[inline(always)]
        fn add(self, other: Self) -> Self {
            // SAFETY: AVX2 is present (module comment).
            Self(unsafe { _mm256_add_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn sub(self, other: Self) -> Self {
            // SAFETY: AVX2 is present (module comment).
            Self(unsafe { _mm256_sub_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn mul(self, other: Self) -> Self {
            // SAFETY: AVX2 is present (module comment).
            Self(unsafe { _mm256_mul_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn mul_add(self, factor: Self, summand: Self) -> Self {
            // SAFETY: FMA is present (module comment).
            Self(unsafe { _mm256_fmadd_ps(self.0, factor.0, summand.0) })
        }
        #[inline(always)]
        fn neg_mul_add(self, factor: Self, summand: Self) -> Self {
            // SAFETY: FMA is present (module comment).
            Self(unsafe { _mm256_fnmadd_ps(self.0, factor.0, summand.0) })
        }
        #[inline(always)]
        fn min(self, other: Self) -> Self {
            // SAFETY: AVX2 is present (module comment).
            Self(unsafe { _mm256_min_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            // SAFETY: AVX2 is present (module comment).
            Self(unsafe { _mm256_max_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn abs(self) -> Self {
            // SAFETY: AVX2 is present (module comment).
            Self(unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0) })
        }
        #[inline(always)]
        fn le(self, other: Self) -> u32 {
            // SAFETY: AVX2 is present (module comment).
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(self.0, other.0)) as u32 }
        }
        #[inline(always)]
        fn lt(self, other: Self) -> u32 {
            // SAFETY: AVX2 is present (module comment).
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0)) as u32 }
        }
        #[inline(always)]
        fn flip(self, other: Self) -> Self {
            // SAFETY: AVX2 is present (module comment).
            Self(unsafe { _mm256_xor_ps(self.0, _mm256_and_ps(_mm256_set1_ps(-0.0), other.0)) })
        }
        #[inline(always)]
        fn compress(values: &[u32; 8], mask: u32, out: &mut [u32; 8]) {
            let bytes = POSITIONS[(mask & 255) as usize].cast_signed();
            // SAFETY: AVX2 is present (module comment); the pointers are to eight u32, any alignment.
            unsafe {
                let positions = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(bytes));
                let values = _mm256_loadu_si256(values.as_ptr().cast());
                let packed = _mm256_permutevar8x32_epi32(values, positions);
                _mm256_storeu_si256(out.as_mut_ptr().cast(), packed);
            }
        }
    }
}
