//! Every symbol against the plain definition of what it computes, as Clarabel would call it.

use super::*;

/// Entries that look random and are the same every time, in [-1, 1).
struct Entries(u64);

impl Entries {
    fn next(&mut self) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

/// The tests for one kind of number and its symbols.
macro_rules! conformance {
    ($name:ident, $T:ty, $tolerance:expr,
     $gemm:ident $gemv:ident $symv:ident $syrk:ident $syr2k:ident $potrf:ident $potrs:ident
     $gesv:ident $gesdd:ident $gesvd:ident $syevr:ident) => {
        mod $name {
            use super::*;

            type M = DMatrix<$T>;

            fn random(seed: u64, rows: usize, columns: usize) -> M {
                let mut entries = Entries(seed);
                M::from_fn(rows, columns, |_, _| entries.next() as $T)
            }

            fn symmetric(seed: u64, n: usize) -> M {
                let a = random(seed, n, n);
                &a + a.transpose()
            }

            fn positive(seed: u64, n: usize) -> M {
                let a = random(seed, n, n);
                &a * a.transpose() + M::identity(n, n)
            }

            fn c(text: &str) -> c_char {
                text.as_bytes()[0] as c_char
            }

            fn n(size: usize) -> c_int {
                size as c_int
            }

            fn close(a: &M, b: &M) -> bool {
                a.shape() == b.shape() && (a - b).amax() <= $tolerance
            }

            /// One triangle of `new` over `old`.
            fn triangle(uplo: &str, new: &M, old: &M) -> M {
                let has = |i: usize, j: usize| if uplo == "U" { i <= j } else { i >= j };
                M::from_fn(new.nrows(), new.ncols(), |i, j| {
                    if has(i, j) { new[(i, j)] } else { old[(i, j)] }
                })
            }

            #[test]
            fn gemm_multiplies_with_every_transpose() {
                for (ta, tb) in [("N", "N"), ("T", "N"), ("N", "T"), ("T", "T")] {
                    let (plain_a, plain_b) = (random(1, 4, 3), random(2, 3, 5));
                    let a = if ta == "T" { plain_a.transpose() } else { plain_a.clone() };
                    let b = if tb == "T" { plain_b.transpose() } else { plain_b.clone() };
                    let start = random(3, 4, 5);
                    let mut found = start.clone();
                    let (alpha, beta): ($T, $T) = (1.5, -0.5);
                    // SAFETY: matrices of the sizes given.
                    unsafe {
                        $gemm(
                            &c(ta),
                            &c(tb),
                            &n(4),
                            &n(5),
                            &n(3),
                            &alpha,
                            a.as_ptr(),
                            &n(a.nrows()),
                            b.as_ptr(),
                            &n(b.nrows()),
                            &beta,
                            found.as_mut_ptr(),
                            &n(4),
                        );
                    }
                    let wanted = M::from_fn(4, 5, |i, j| {
                        let sum: $T = (0..3).map(|k| plain_a[(i, k)] * plain_b[(k, j)]).sum();
                        alpha * sum + beta * start[(i, j)]
                    });
                    assert!(close(&found, &wanted), "{ta}{tb}: {found} {wanted}");
                }
            }

            #[test]
            fn a_zero_beta_overwrites_even_what_is_not_a_number() {
                let (a, b) = (random(1, 2, 2), random(2, 2, 2));
                let mut found = M::from_element(2, 2, <$T>::NAN);
                // SAFETY: matrices of the sizes given.
                unsafe {
                    $gemm(
                        &c("N"),
                        &c("N"),
                        &n(2),
                        &n(2),
                        &n(2),
                        &1.0,
                        a.as_ptr(),
                        &n(2),
                        b.as_ptr(),
                        &n(2),
                        &0.0,
                        found.as_mut_ptr(),
                        &n(2),
                    );
                }
                assert!(close(&found, &(a * b)), "{found}");
            }

            #[test]
            fn a_leading_dimension_leaves_the_rest_of_the_memory_alone() {
                let (a, b) = (random(1, 5, 4), random(2, 6, 4));
                let mut found = M::from_element(7, 4, 9.0);
                // SAFETY: the matrices are corners of larger ones, by their leading dimensions.
                unsafe {
                    $gemm(
                        &c("N"),
                        &c("N"),
                        &n(3),
                        &n(4),
                        &n(4),
                        &1.0,
                        a.as_ptr(),
                        &n(5),
                        b.as_ptr(),
                        &n(6),
                        &0.0,
                        found.as_mut_ptr(),
                        &n(7),
                    );
                }
                let corner = a.rows(0, 3) * b.rows(0, 4);
                assert!(close(&found.rows(0, 3).into_owned(), &corner), "{found}");
                assert!(found.rows(3, 4).iter().all(|x| *x == 9.0), "{found}");
            }

            #[test]
            fn gemv_multiplies_with_steps_forwards_and_backwards() {
                for trans in ["N", "T"] {
                    let a = random(4, 3, 4);
                    let plain = if trans == "T" { a.transpose() } else { a.clone() };
                    let (rows, columns) = plain.shape();
                    let (x, start) = (random(5, 2 * columns, 1), random(6, rows, 1));
                    let mut found = start.clone();
                    // SAFETY: vectors of the sizes and steps given.
                    unsafe {
                        $gemv(
                            &c(trans),
                            &n(3),
                            &n(4),
                            &2.0,
                            a.as_ptr(),
                            &n(3),
                            x.as_ptr(),
                            &2,
                            &0.5,
                            found.as_mut_ptr(),
                            &-1,
                        );
                    }
                    let wanted = M::from_fn(rows, 1, |i, _| {
                        // The result's entry for row i lies backwards.
                        let row = rows - 1 - i;
                        let sum: $T = (0..columns).map(|k| plain[(row, k)] * x[2 * k]).sum();
                        2.0 * sum + 0.5 * start[i]
                    });
                    assert!(close(&found, &wanted), "{trans}: {found} {wanted}");
                }
            }

            #[test]
            fn symv_reads_one_triangle_only() {
                for uplo in ["U", "L"] {
                    let full = symmetric(7, 4);
                    let a = triangle(uplo, &full, &M::from_element(4, 4, <$T>::NAN));
                    let (x, start) = (random(8, 4, 1), random(9, 4, 1));
                    let mut found = start.clone();
                    // SAFETY: arrays of the sizes given.
                    unsafe {
                        $symv(
                            &c(uplo),
                            &n(4),
                            &3.0,
                            a.as_ptr(),
                            &n(4),
                            x.as_ptr(),
                            &1,
                            &1.0,
                            found.as_mut_ptr(),
                            &1,
                        );
                    }
                    assert!(close(&found, &(full * x * 3.0 + start)), "{uplo}: {found}");
                }
            }

            #[test]
            fn syrk_and_syr2k_write_one_triangle_only() {
                for (uplo, trans) in [("U", "N"), ("L", "N"), ("U", "T"), ("L", "T")] {
                    let (plain_a, plain_b) = (random(10, 4, 3), random(11, 4, 3));
                    let turned = |m: &M| if trans == "T" { m.transpose() } else { m.clone() };
                    let (a, b) = (turned(&plain_a), turned(&plain_b));
                    let start = random(12, 4, 4);
                    let (mut rank_k, mut rank_2k) = (start.clone(), start.clone());
                    let lead = n(a.nrows());
                    // SAFETY: matrices of the sizes given.
                    unsafe {
                        $syrk(
                            &c(uplo),
                            &c(trans),
                            &n(4),
                            &n(3),
                            &2.0,
                            a.as_ptr(),
                            &lead,
                            &-1.0,
                            rank_k.as_mut_ptr(),
                            &n(4),
                        );
                        $syr2k(
                            &c(uplo),
                            &c(trans),
                            &n(4),
                            &n(3),
                            &2.0,
                            a.as_ptr(),
                            &lead,
                            b.as_ptr(),
                            &lead,
                            &-1.0,
                            rank_2k.as_mut_ptr(),
                            &n(4),
                        );
                    }
                    let one = &plain_a * plain_a.transpose() * 2.0 - &start;
                    let cross = &plain_a * plain_b.transpose();
                    let two = (&cross + cross.transpose()) * 2.0 - &start;
                    assert!(close(&rank_k, &triangle(uplo, &one, &start)), "{uplo}{trans}");
                    assert!(close(&rank_2k, &triangle(uplo, &two, &start)), "{uplo}{trans}");
                }
            }

            #[test]
            fn potrf_factors_and_potrs_solves() {
                for uplo in ["U", "L"] {
                    let a = positive(13, 5);
                    let b = random(14, 5, 2);
                    let old = M::from_element(5, 5, 7.0);
                    let mut factor = triangle(uplo, &a, &old);
                    let (mut x, mut status) = (b.clone(), -9);
                    // SAFETY: matrices of the sizes given.
                    unsafe {
                        $potrf(&c(uplo), &n(5), factor.as_mut_ptr(), &n(5), &mut status);
                        assert_eq!(status, 0);
                        $potrs(
                            &c(uplo),
                            &n(5),
                            &n(2),
                            factor.as_ptr(),
                            &n(5),
                            x.as_mut_ptr(),
                            &n(5),
                            &mut status,
                        );
                    }
                    assert_eq!(status, 0);
                    let kept = triangle(uplo, &old, &factor);
                    assert!(close(&kept, &old), "the other triangle was touched: {factor}");
                    let f = triangle(uplo, &factor, &M::zeros(5, 5));
                    let again = if uplo == "U" { f.transpose() * &f } else { &f * f.transpose() };
                    assert!(close(&again, &a), "{uplo}: {again} {a}");
                    assert!(close(&(a * x), &b), "{uplo}");
                }
            }

            #[test]
            fn potrf_names_the_first_minor_that_is_not_positive() {
                let mut a = M::identity(4, 4);
                a[(2, 2)] = -1.0;
                let mut status = 0;
                // SAFETY: a matrix of the size given.
                unsafe { $potrf(&c("L"), &n(4), a.as_mut_ptr(), &n(4), &mut status) };
                assert_eq!(status, 3);
            }

            #[test]
            fn gesv_solves_with_row_exchanges() {
                let mut a = random(15, 5, 5);
                a[(0, 0)] = 0.0;
                let (plain, b) = (a.clone(), random(16, 5, 3));
                let (mut x, mut pivots, mut status) = (b.clone(), [0; 5], -9);
                // SAFETY: arrays of the sizes given.
                unsafe {
                    $gesv(
                        &n(5),
                        &n(3),
                        a.as_mut_ptr(),
                        &n(5),
                        pivots.as_mut_ptr(),
                        x.as_mut_ptr(),
                        &n(5),
                        &mut status,
                    );
                }
                assert_eq!(status, 0);
                assert!(close(&(&plain * x), &b));
                let mut exchanged = plain;
                for (i, row) in pivots.iter().enumerate() {
                    exchanged.swap_rows(i, *row as usize - 1);
                }
                let unit = a.lower_triangle() - M::from_diagonal(&a.diagonal()) + M::identity(5, 5);
                assert!(close(&(unit * a.upper_triangle()), &exchanged));
            }

            #[test]
            fn gesv_names_the_zero_pivot_of_a_singular_matrix() {
                let (mut a, mut b) = (M::from_element(3, 3, 1.0), random(17, 3, 1));
                let (mut pivots, mut status) = ([0; 3], -9);
                // SAFETY: arrays of the sizes given.
                unsafe {
                    $gesv(
                        &n(3),
                        &n(1),
                        a.as_mut_ptr(),
                        &n(3),
                        pivots.as_mut_ptr(),
                        b.as_mut_ptr(),
                        &n(3),
                        &mut status,
                    );
                }
                assert_eq!(status, 2);
            }

            /// Decomposes and puts together again: (U S Vᵀ, U, s, Vᵀ, info).
            fn svd(a: &M, divide: bool) -> (M, M, M, M, c_int) {
                let (rows, columns) = a.shape();
                let k = rows.min(columns);
                let mut work_a = a.clone();
                let (mut s, mut u, mut vt) =
                    (M::zeros(k, 1), M::zeros(rows, k), M::zeros(k, columns));
                let (mut work, mut iwork, mut status) = ([0.0; 1], [0; 1], -9);
                for lwork in [-1, 1] {
                    // SAFETY: arrays of the sizes given.
                    unsafe {
                        if divide {
                            $gesdd(
                                &c("S"),
                                &n(rows),
                                &n(columns),
                                work_a.as_mut_ptr(),
                                &n(rows),
                                s.as_mut_ptr(),
                                u.as_mut_ptr(),
                                &n(rows),
                                vt.as_mut_ptr(),
                                &n(k),
                                work.as_mut_ptr(),
                                &lwork,
                                iwork.as_mut_ptr(),
                                &mut status,
                            );
                        } else {
                            $gesvd(
                                &c("S"),
                                &c("S"),
                                &n(rows),
                                &n(columns),
                                work_a.as_mut_ptr(),
                                &n(rows),
                                s.as_mut_ptr(),
                                u.as_mut_ptr(),
                                &n(rows),
                                vt.as_mut_ptr(),
                                &n(k),
                                work.as_mut_ptr(),
                                &lwork,
                                &mut status,
                            );
                        }
                    }
                }
                let middle = M::from_fn(k, k, |i, j| if i == j { s[i] } else { 0.0 });
                (&u * middle * &vt, u, s, vt, status)
            }

            #[test]
            fn singular_values_are_right_for_every_shape_and_order() {
                for order in 4..=20 {
                    for (rows, columns) in [(order, order), (order + 2, order), (order, order + 3)]
                    {
                        for divide in [true, false] {
                            let a = random(18 + order as u64, rows, columns);
                            let (again, u, s, vt, status) = svd(&a, divide);
                            assert_eq!(status, 0);
                            let k = rows.min(columns);
                            assert!(
                                close(&again, &a),
                                "{rows} x {columns}: {}",
                                (again - a).amax()
                            );
                            assert!(close(&(u.transpose() * u), &M::identity(k, k)));
                            assert!(close(&(&vt * vt.transpose()), &M::identity(k, k)));
                            assert!(s.as_slice().windows(2).all(|pair| pair[0] >= pair[1]));
                        }
                    }
                }
            }

            #[test]
            fn singular_values_of_graded_columns_are_right() {
                for order in 4..=12 {
                    let mut a = random(50 + order as u64, order, order);
                    for j in 0..order {
                        a.column_mut(j).scale_mut((0.1 as $T).powi((j % 7) as i32));
                    }
                    let (again, ..) = svd(&a, true);
                    assert!(close(&again, &a), "{order}: {}", (again - a).amax());
                }
            }

            #[test]
            fn syevr_finds_all_eigenvalues_in_order() {
                for (order, uplo) in (4..=20).flat_map(|order| [(order, "U"), (order, "L")]) {
                    let full = symmetric(80 + order as u64, order);
                    let mut a = triangle(uplo, &full, &M::from_element(order, order, <$T>::NAN));
                    let (mut w, mut z) = (M::zeros(order, 1), M::zeros(order, order));
                    let (mut found, mut support) = (0, vec![0; 2 * order]);
                    let (mut work, mut iwork, mut status) = ([0.0; 1], [0; 1], -9);
                    for size in [-1, 1] {
                        // SAFETY: arrays of the sizes given.
                        unsafe {
                            $syevr(
                                &c("V"),
                                &c("A"),
                                &c(uplo),
                                &n(order),
                                a.as_mut_ptr(),
                                &n(order),
                                &0.0,
                                &0.0,
                                &0,
                                &0,
                                &0.0,
                                &mut found,
                                w.as_mut_ptr(),
                                z.as_mut_ptr(),
                                &n(order),
                                support.as_mut_ptr(),
                                work.as_mut_ptr(),
                                &size,
                                iwork.as_mut_ptr(),
                                &size,
                                &mut status,
                            );
                        }
                    }
                    assert_eq!((status, found), (0, n(order)));
                    let middle = M::from_fn(order, order, |i, j| if i == j { w[i] } else { 0.0 });
                    assert!(close(&(&z * middle * z.transpose()), &full), "{order}");
                    assert!(close(&(z.transpose() * &z), &M::identity(order, order)));
                    assert!(w.as_slice().windows(2).all(|pair| pair[0] <= pair[1]));
                }
            }

            #[test]
            fn numbers_that_are_none_end_in_a_failure() {
                let a = M::from_element(4, 4, <$T>::NAN);
                assert!(svd(&a, true).4 > 0);
                let (mut b, mut w, mut found) = (a.clone(), M::zeros(4, 1), 0);
                let (mut work, mut iwork, mut status) = ([0.0; 1], [0; 1], 0);
                // SAFETY: arrays of the sizes given; there is no Z with the letter N.
                unsafe {
                    $syevr(
                        &c("N"),
                        &c("A"),
                        &c("U"),
                        &n(4),
                        b.as_mut_ptr(),
                        &n(4),
                        &0.0,
                        &0.0,
                        &0,
                        &0,
                        &0.0,
                        &mut found,
                        w.as_mut_ptr(),
                        core::ptr::null_mut(),
                        &n(1),
                        core::ptr::null_mut(),
                        work.as_mut_ptr(),
                        &1,
                        iwork.as_mut_ptr(),
                        &1,
                        &mut status,
                    );
                }
                assert!(status > 0);
                let mut b = a;
                // SAFETY: a matrix of the size given.
                unsafe { $potrf(&c("U"), &n(4), b.as_mut_ptr(), &n(4), &mut status) };
                assert!(status > 0);
            }
        }
    };
}

conformance!(double, f64, 1e-11,
    dgemm_ dgemv_ dsymv_ dsyrk_ dsyr2k_ dpotrf_ dpotrs_ dgesv_ dgesdd_ dgesvd_ dsyevr_);
conformance!(single, f32, 1e-4,
    sgemm_ sgemv_ ssymv_ ssyrk_ ssyr2k_ spotrf_ spotrs_ sgesv_ sgesdd_ sgesvd_ ssyevr_);
