//! The recorded QPs and how they are stored, for tests and benchmarks.

use law::qp::{CONSTRAINTS, Qp, ROWS, VARIABLES};

/// One recorded problem.
pub struct Recorded {
    /// Recording it is part of.
    #[allow(dead_code, reason = "not everybody who reads them asks for their order")]
    pub sequence: u32,
    /// The problem.
    pub qp: Qp,
    /// Its solution, refined.
    #[allow(dead_code, reason = "a benchmark does not ask whether it is right")]
    pub exact: [f64; VARIABLES],
}

/// What is left to read of the file.
struct Bytes<'a>(&'a [u8]);

impl Bytes<'_> {
    fn take<const N: usize>(&mut self) -> [u8; N] {
        let (head, tail) = self.0.split_at(N);
        self.0 = tail;
        head.try_into().expect("as many as asked for")
    }

    fn u32(&mut self) -> u32 {
        u32::from_le_bytes(self.take())
    }

    fn place(&mut self) -> usize {
        u16::from_le_bytes(self.take()).into()
    }

    fn f64(&mut self) -> f64 {
        f64::from_le_bytes(self.take())
    }
}

/// Reads the file described in `data/README.md`.
pub fn recorded() -> Vec<Recorded> {
    let mut bytes = Bytes(include_bytes!("../data/obstacle_avoidance.qps"));
    assert_eq!(&bytes.take(), b"PLATOONQ");
    let (count, pairs, slots) = (bytes.u32(), bytes.u32(), bytes.u32());
    let length = VARIABLES * VARIABLES + VARIABLES + ROWS * VARIABLES + 2 * CONSTRAINTS;
    let template: Vec<f64> = (0..length).map(|_| bytes.f64()).collect();
    let pairs: Vec<_> = (0..pairs).map(|_| (bytes.place(), bytes.place())).collect();
    let mut one = || {
        let sequence = bytes.u32();
        let values: Vec<f64> = (0..slots).map(|_| bytes.f64()).collect();
        let mut flat = template.clone();
        for &(place, slot) in &pairs {
            flat[place] = values[slot];
        }
        Recorded { sequence, qp: qp_of(&flat), exact: std::array::from_fn(|_| bytes.f64()) }
    };
    (0..count).map(|_| one()).collect()
}

/// H and A row by row, g, and the limits, one after the other.
fn qp_of(flat: &[f64]) -> Qp {
    let (hessian, rest) = flat.split_at(VARIABLES * VARIABLES);
    let (gradient, rest) = rest.split_at(VARIABLES);
    let (rows, limits) = rest.split_at(ROWS * VARIABLES);
    let mut qp = Qp::empty();
    for j in 0..VARIABLES {
        (0..VARIABLES).for_each(|i| qp.hessian[(i, j)] = hessian[i * VARIABLES + j]);
        (0..ROWS).for_each(|i| qp.rows[(i, j)] = rows[i * VARIABLES + j]);
    }
    qp.gradient.copy_from_slice(gradient);
    qp.lower.copy_from_slice(&limits[..CONSTRAINTS]);
    qp.upper.copy_from_slice(&limits[CONSTRAINTS..]);
    qp
}
