//! The symbols, in Fortran's calling convention.
//!
//! Every argument is a pointer, matrices are column-major with a leading dimension, one letter says
//! which part or which transpose. A panic must not cross this border, so whatever a caller could
//! get wrong is an `info` value here, or nothing happens.

#![expect(unsafe_code, reason = "the symbols that Clarabel's linker looks for take raw pointers")]

use core::ffi::{c_char, c_int};
use core::slice;

use nalgebra::{DMatrix, DVector};

use crate::dense::{self, Failed, Part, Real, View, ViewMut};

/// The letter behind a pointer, in upper case.
///
/// # Safety
/// `letter` points to a character.
unsafe fn letter(letter: *const c_char) -> u8 {
    // SAFETY: by the contract of this function.
    unsafe { *letter as u8 }.to_ascii_uppercase()
}

/// The size behind a pointer; a negative one counts as 0, which computes nothing.
///
/// # Safety
/// `size` points to an integer.
unsafe fn size(size: *const c_int) -> usize {
    // SAFETY: by the contract of this function.
    usize::try_from(unsafe { *size }).unwrap_or(0)
}

/// Entries from the first to the last of a matrix.
const fn span(rows: usize, columns: usize, leading: usize) -> usize {
    if rows == 0 || columns == 0 { 0 } else { (columns - 1) * leading + rows }
}

/// # Safety
/// `at` points to a column-major matrix of this size, which nobody writes meanwhile, and
/// `leading >= rows`.
unsafe fn view<'a, T: Real>(
    at: *const T,
    rows: usize,
    columns: usize,
    leading: usize,
) -> View<'a, T> {
    let length = span(rows, columns, leading);
    if length == 0 {
        return View::from_slice_with_strides(&[], rows, columns, 1, leading.max(1));
    }
    // SAFETY: by the contract of this function; the slice ends with the matrix's last entry.
    let entries = unsafe { slice::from_raw_parts(at, length) };
    View::from_slice_with_strides(entries, rows, columns, 1, leading)
}

/// # Safety
/// As [`view`], and nobody else reads it meanwhile.
unsafe fn view_mut<'a, T: Real>(
    at: *mut T,
    rows: usize,
    columns: usize,
    leading: usize,
) -> ViewMut<'a, T> {
    let length = span(rows, columns, leading);
    if length == 0 {
        return ViewMut::from_slice_with_strides_mut(&mut [], rows, columns, 1, leading.max(1));
    }
    // SAFETY: by the contract of this function; the slice ends with the matrix's last entry.
    let entries = unsafe { slice::from_raw_parts_mut(at, length) };
    ViewMut::from_slice_with_strides_mut(entries, rows, columns, 1, leading)
}

/// Where entry `i` of `n` is, from the pointer on: a vector with a negative step lies backwards.
const fn place(i: usize, n: usize, step: isize) -> isize {
    if step >= 0 { i as isize * step } else { (i as isize - (n as isize - 1)) * step }
}

/// # Safety
/// `at` points to `n` entries, `step` apart.
unsafe fn vector<T: Real>(at: *const T, n: usize, step: *const c_int) -> DVector<T> {
    // SAFETY: by the contract of this function.
    let step = unsafe { *step } as isize;
    // SAFETY: `place` stays within the n entries.
    DVector::from_fn(n, |i, _| unsafe { *at.offset(place(i, n, step)) })
}

/// `y <- product + beta y`; with `beta` 0, y is not read.
///
/// # Safety
/// `at` points to as many entries as `product` has, `step` apart, which nobody else uses.
unsafe fn blend_vector<T: Real>(product: &DVector<T>, beta: T, at: *mut T, step: *const c_int) {
    // SAFETY: by the contract of this function.
    let step = unsafe { *step } as isize;
    for (i, new) in product.iter().enumerate() {
        // SAFETY: `place` stays within the vector.
        let entry = unsafe { &mut *at.offset(place(i, product.len(), step)) };
        let old = if beta.is_zero() { T::zero() } else { beta * *entry };
        *entry = old + *new;
    }
}

/// op(A) of a product: A with `rows` x `columns` after a transpose that the letter may ask for.
///
/// # Safety
/// As [`letter`], [`size`] and [`view`].
unsafe fn operand<T: Real>(
    transpose: *const c_char,
    at: *const T,
    (rows, columns): (usize, usize),
    leading: *const c_int,
) -> DMatrix<T> {
    // SAFETY: by the contract of this function.
    unsafe {
        match letter(transpose) {
            b'N' => view(at, rows, columns, size(leading)).into_owned(),
            _ => view(at, columns, rows, size(leading)).transpose(),
        }
    }
}

const fn part(letter: u8) -> Part {
    if letter == b'U' { Part::Upper } else { Part::Lower }
}

/// LAPACK's `info`: 0, or why there is no result.
const fn info(outcome: &Result<(), Failed>) -> c_int {
    match outcome {
        Ok(()) => 0,
        Err(Failed::Minor(order)) => *order as c_int,
        Err(Failed::Search) => 1,
    }
}

/// A thin singular value decomposition into its three places; `None` for singular values only.
fn write_singular<T: Real>(
    a: &View<'_, T>,
    s: &mut ViewMut<'_, T>,
    vectors: Option<(ViewMut<'_, T>, ViewMut<'_, T>)>,
) -> Result<(), Failed> {
    let found = dense::singular(a)?;
    dense::blend(
        &DMatrix::from_column_slice(found.s.len(), 1, found.s.as_slice()),
        T::zero(),
        s,
        Part::Whole,
    );
    if let Some((mut u, mut vt)) = vectors {
        dense::blend(&found.u, T::zero(), &mut u, Part::Whole);
        dense::blend(&found.vt, T::zero(), &mut vt, Part::Whole);
    }
    Ok(())
}

/// What is asked of a singular value decomposition, by its letter: vectors or none. The full sets
/// of vectors of an oblong matrix, and results written over A, are not offered.
fn wants_vectors(letter: u8, m: usize, n: usize) -> Option<bool> {
    match letter {
        b'N' => Some(false),
        b'S' => Some(true),
        b'A' if m == n => Some(true),
        _ => None,
    }
}

/// Defines the routines for one kind of number.
macro_rules! symbols {
    ($T:ty: $gemm:ident $gemv:ident $symv:ident $syrk:ident $syr2k:ident $potrf:ident $potrs:ident
     $gesv:ident $gesdd:ident $gesvd:ident $syevr:ident) => {
        // C <- alpha op(A) op(B) + beta C
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $gemm(
            transa: *const c_char,
            transb: *const c_char,
            m: *const c_int,
            n: *const c_int,
            k: *const c_int,
            alpha: *const $T,
            a: *const $T,
            lda: *const c_int,
            b: *const $T,
            ldb: *const c_int,
            beta: *const $T,
            c: *mut $T,
            ldc: *const c_int,
        ) {
            // SAFETY: the caller keeps BLAS's contract: pointers to matrices of these sizes.
            unsafe {
                let (m, n, k) = (size(m), size(n), size(k));
                let a = operand(transa, a, (m, k), lda);
                let b = operand(transb, b, (k, n), ldb);
                let mut c = view_mut(c, m, n, size(ldc));
                dense::blend(&(a * b * *alpha), *beta, &mut c, Part::Whole);
            }
        }

        // y <- alpha op(A) x + beta y
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $gemv(
            trans: *const c_char,
            m: *const c_int,
            n: *const c_int,
            alpha: *const $T,
            a: *const $T,
            lda: *const c_int,
            x: *const $T,
            incx: *const c_int,
            beta: *const $T,
            y: *mut $T,
            incy: *const c_int,
        ) {
            // SAFETY: the caller keeps BLAS's contract: pointers to arrays of these sizes.
            unsafe {
                let (m, n) = (size(m), size(n));
                let shape = if letter(trans) == b'N' { (m, n) } else { (n, m) };
                let x = vector(x, shape.1, incx);
                let product = operand(trans, a, shape, lda) * x * *alpha;
                blend_vector(&product, *beta, y, incy);
            }
        }

        // y <- alpha A x + beta y, A symmetric
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $symv(
            uplo: *const c_char,
            n: *const c_int,
            alpha: *const $T,
            a: *const $T,
            lda: *const c_int,
            x: *const $T,
            incx: *const c_int,
            beta: *const $T,
            y: *mut $T,
            incy: *const c_int,
        ) {
            // SAFETY: the caller keeps BLAS's contract: pointers to arrays of these sizes.
            unsafe {
                let n = size(n);
                let a = dense::symmetric(&view(a, n, n, size(lda)), part(letter(uplo)));
                blend_vector(&(a * vector(x, n, incx) * *alpha), *beta, y, incy);
            }
        }

        // C <- alpha op(A) op(A)ᵀ + beta C, one triangle of C
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $syrk(
            uplo: *const c_char,
            trans: *const c_char,
            n: *const c_int,
            k: *const c_int,
            alpha: *const $T,
            a: *const $T,
            lda: *const c_int,
            beta: *const $T,
            c: *mut $T,
            ldc: *const c_int,
        ) {
            // SAFETY: the caller keeps BLAS's contract: pointers to matrices of these sizes.
            unsafe {
                let (n, k) = (size(n), size(k));
                let a = operand(trans, a, (n, k), lda);
                let mut c = view_mut(c, n, n, size(ldc));
                let product = &a * a.transpose() * *alpha;
                dense::blend(&product, *beta, &mut c, part(letter(uplo)));
            }
        }

        // C <- alpha (op(A) op(B)ᵀ + op(B) op(A)ᵀ) + beta C, one triangle of C
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $syr2k(
            uplo: *const c_char,
            trans: *const c_char,
            n: *const c_int,
            k: *const c_int,
            alpha: *const $T,
            a: *const $T,
            lda: *const c_int,
            b: *const $T,
            ldb: *const c_int,
            beta: *const $T,
            c: *mut $T,
            ldc: *const c_int,
        ) {
            // SAFETY: the caller keeps BLAS's contract: pointers to matrices of these sizes.
            unsafe {
                let (n, k) = (size(n), size(k));
                let a = operand(trans, a, (n, k), lda);
                let b = operand(trans, b, (n, k), ldb);
                let mut c = view_mut(c, n, n, size(ldc));
                let product = (&a * b.transpose() + &b * a.transpose()) * *alpha;
                dense::blend(&product, *beta, &mut c, part(letter(uplo)));
            }
        }

        // Cholesky's factor of A, in place
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $potrf(
            uplo: *const c_char,
            n: *const c_int,
            a: *mut $T,
            lda: *const c_int,
            status: *mut c_int,
        ) {
            // SAFETY: the caller keeps LAPACK's contract: pointers to a matrix of this size.
            unsafe {
                let n = size(n);
                let mut a = view_mut(a, n, n, size(lda));
                *status = info(&dense::factor_cholesky(&mut a, part(letter(uplo))));
            }
        }

        // A X = B with Cholesky's factor of A
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $potrs(
            uplo: *const c_char,
            n: *const c_int,
            nrhs: *const c_int,
            a: *const $T,
            lda: *const c_int,
            b: *mut $T,
            ldb: *const c_int,
            status: *mut c_int,
        ) {
            // SAFETY: the caller keeps LAPACK's contract: pointers to matrices of these sizes.
            unsafe {
                let (n, columns) = (size(n), size(nrhs));
                let a = view(a, n, n, size(lda));
                let mut b = view_mut(b, n, columns, size(ldb));
                dense::solve_cholesky(&a, part(letter(uplo)), &mut b);
                *status = 0;
            }
        }

        // A X = B by elimination
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $gesv(
            n: *const c_int,
            nrhs: *const c_int,
            a: *mut $T,
            lda: *const c_int,
            pivots: *mut c_int,
            b: *mut $T,
            ldb: *const c_int,
            status: *mut c_int,
        ) {
            // SAFETY: the caller keeps LAPACK's contract: pointers to arrays of these sizes.
            unsafe {
                let (n, columns) = (size(n), size(nrhs));
                let mut a = view_mut(a, n, n, size(lda));
                let mut b = view_mut(b, n, columns, size(ldb));
                let outcome = dense::solve_lu(&mut a, &mut b).map(|exchanges| {
                    for (i, row) in exchanges.into_iter().enumerate() {
                        *pivots.add(i) = row as c_int + 1;
                    }
                });
                *status = info(&outcome);
            }
        }

        // A = U diag(s) Vᵀ, thin
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $gesdd(
            jobz: *const c_char,
            m: *const c_int,
            n: *const c_int,
            a: *mut $T,
            lda: *const c_int,
            s: *mut $T,
            u: *mut $T,
            ldu: *const c_int,
            vt: *mut $T,
            ldvt: *const c_int,
            work: *mut $T,
            lwork: *const c_int,
            _iwork: *mut c_int,
            status: *mut c_int,
        ) {
            // SAFETY: the two routines have the same contract, but for the second letter.
            unsafe {
                $gesvd(jobz, jobz, m, n, a, lda, s, u, ldu, vt, ldvt, work, lwork, status);
            }
        }

        // The same, by its older name
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $gesvd(
            jobu: *const c_char,
            jobvt: *const c_char,
            m: *const c_int,
            n: *const c_int,
            a: *mut $T,
            lda: *const c_int,
            s: *mut $T,
            u: *mut $T,
            ldu: *const c_int,
            vt: *mut $T,
            ldvt: *const c_int,
            work: *mut $T,
            lwork: *const c_int,
            status: *mut c_int,
        ) {
            // SAFETY: the caller keeps LAPACK's contract: pointers to arrays of these sizes.
            unsafe {
                *status = 0;
                if *lwork == -1 {
                    *work = 1.0; // Somebody asks how much work space is needed.
                    return;
                }
                let (m, n) = (size(m), size(n));
                let k = m.min(n);
                let wants = wants_vectors(letter(jobu), m, n);
                let Some(wants) = wants.filter(|_| letter(jobu) == letter(jobvt)) else {
                    *status = -1;
                    return;
                };
                let vectors =
                    wants.then(|| (view_mut(u, m, k, size(ldu)), view_mut(vt, k, n, size(ldvt))));
                let (a, mut s) = (view(a, m, n, size(lda)), view_mut(s, k, 1, k));
                *status = info(&write_singular(&a, &mut s, vectors));
            }
        }

        // A = Z diag(w) Zᵀ, A symmetric, all eigenvalues
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $syevr(
            jobz: *const c_char,
            range: *const c_char,
            uplo: *const c_char,
            n: *const c_int,
            a: *mut $T,
            lda: *const c_int,
            _vl: *const $T,
            _vu: *const $T,
            _il: *const c_int,
            _iu: *const c_int,
            _abstol: *const $T,
            found: *mut c_int,
            w: *mut $T,
            z: *mut $T,
            ldz: *const c_int,
            _isuppz: *mut c_int,
            work: *mut $T,
            lwork: *const c_int,
            iwork: *mut c_int,
            liwork: *const c_int,
            status: *mut c_int,
        ) {
            // SAFETY: the caller keeps LAPACK's contract: pointers to arrays of these sizes.
            unsafe {
                *status = 0;
                if *lwork == -1 || *liwork == -1 {
                    (*work, *iwork) = (1.0, 1); // Somebody asks how much work space is needed.
                    return;
                }
                if letter(range) != b'A' {
                    *status = -2;
                    return;
                }
                let n = size(n);
                let outcome = dense::eigen(&view(a, n, n, size(lda)), part(letter(uplo)));
                *found = n as c_int;
                *status = info(&outcome.map(|(values, vectors)| {
                    slice::from_raw_parts_mut(w, n).copy_from_slice(values.as_slice());
                    if letter(jobz) == b'V' {
                        let mut z = view_mut(z, n, n, size(ldz));
                        dense::blend(&vectors, 0.0, &mut z, Part::Whole);
                    }
                }));
            }
        }
    };
}

symbols!(f64: dgemm_ dgemv_ dsymv_ dsyrk_ dsyr2k_ dpotrf_ dpotrs_ dgesv_ dgesdd_ dgesvd_ dsyevr_);
symbols!(f32: sgemm_ sgemv_ ssymv_ ssyrk_ ssyr2k_ spotrf_ spotrs_ sgesv_ sgesdd_ sgesvd_ ssyevr_);

#[cfg(test)]
#[path = "abi/tests.rs"]
mod tests;
