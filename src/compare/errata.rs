//! Where the paper contradicts itself or cannot be meant as printed, and what we leave out.

use serde::Serialize;

/// One of the paper's inconsistencies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Erratum {
    /// Equation, table, figure or section.
    pub place: &'static str,
    /// What is wrong with it.
    pub what: &'static str,
    /// What we do instead.
    pub here: &'static str,
}

/// Something of the paper that is not here.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct OutOfScope {
    /// Equation, table, figure or section.
    pub place: &'static str,
    /// What it is.
    pub what: &'static str,
    /// Why it is not here.
    pub why: &'static str,
}

const fn erratum(place: &'static str, what: &'static str, here: &'static str) -> Erratum {
    Erratum { place, what, here }
}

/// The paper's inconsistencies, in its order.
pub const ERRATA: [Erratum; 23] = [
    erratum(
        "abstract, III-D",
        "improvements of 19.2, 59.8, 15.3 % are those of platooning, merging, avoidance in \
         the one and of platooning, avoidance, merging in the other",
        "both orders stand in the table",
    ),
    erratum(
        "Eq. 1",
        "τᵢ is called a time delay; it is the time constant of a lag, and Table II leaves it out",
        "0.25 s for the plant; 0.43 to 0.45 s fits the published gain",
    ),
    erratum(
        "Eqs. 3, 6",
        "the disturbance is a₀ in the text, [a₀, a₀'] in B_w; block-diagonal B_w means \
         independent disturbances, where every follower has the same",
        "decides whether K̄₂ > 0 comes out of a synthesis",
    ),
    erratum(
        "Eq. 4",
        "one λ_t for all channels, but every channel is simulated with its own",
        "every link its own delay",
    ),
    erratum(
        "Eq. 4",
        "μ₁ < 1 excludes any message that is held until the next: its age grows at rate 1",
        "certificates for any rate (Q = 0)",
    ),
    erratum("Eq. 6", "the history runs over [-h₁, 0], not [-∞, 0]", "nothing depends on it"),
    erratum(
        "Theorem 1",
        "called necessary and sufficient; it is sufficient, for γ > 0 and a zero initial state",
        "gains are accepted by their certificate alone",
    ),
    erratum("Eq. 10", "∞-norms; what follows from Eq. 7 is a bound on the L₂ gain", "L₂ gain"),
    erratum(
        "Eq. 11",
        "multiplies a vector of three blocks with a matrix of five",
        "Schur complement of the three",
    ),
    erratum(
        "Eq. 12",
        "P̄, Q̄, Z̄ < 0 must be > 0, and γ is missing: it is a feasibility problem at a fixed γ",
        "> 0, γ outside",
    ),
    erratum("below Eq. 12", "K = Ȳ P̄ must be Ȳ P̄⁻¹", "Ȳ P̄⁻¹"),
    erratum(
        "Eqs. 3 to 9",
        "Z is an output and a matrix of the functional",
        "docs/notation.md has one name each",
    ),
    erratum(
        "Table II",
        "l_z stands for I_z; 1.11 m and 34 802.6 kg m² are the sprung mass's",
        "as printed; docs/plant.md",
    ),
    erratum(
        "Eqs. 13, 21",
        "tracking speed without drag and rolling resistance leaves a standing error",
        "both stand in the prediction model",
    ),
    erratum("Eq. 20", "the rotation by θ̄ does not change a norm", "left out"),
    erratum(
        "Eq. 20",
        "Y_s has u sin θ + u_o sin θ with one θ for two vehicles, and signed",
        "lateral closing speed",
    ),
    erratum("Eq. 21", "‖U‖ with the weight Q_obs is no square of a norm", "linear"),
    erratum(
        "Eq. 21",
        "ε is penalised and appears in no constraint",
        "slack of lateral limits, gap, lateral acceleration",
    ),
    erratum(
        "Eq. 21, Table II",
        "R = 100 on newtons freezes the truck, on m/s² the force chatters",
        "kN and degrees",
    ),
    erratum(
        "Eq. 22, Fig. 16",
        "with a = 10000 and U as printed the weight moves by less than 1 %, not as in Fig. 16",
        "U in units of 1000",
    ),
    erratum(
        "III-A, Table III",
        "a deviation from the leader and 0.61 m do not go together under one reading of Eq. 4",
        "Eq. 4 as printed; --delay-reading has the others",
    ),
    erratum(
        "Eqs. 12, 13",
        "the source gives both the label Eq12, so a reference to the one may mean the other",
        "equations by their printed numbers",
    ),
    erratum(
        "Table III",
        "sets MCF on trucks with delay beside DMPC on passenger cars without, from reference [15]",
        "every controller on the same trucks, with the same delay",
    ),
];

/// What of the paper is not here.
pub const OUT_OF_SCOPE: [OutOfScope; 4] = [
    OutOfScope {
        place: "V, future work",
        what: "road tests with real vehicles",
        why: "a bench on a laptop; --bus socketcan --arm drives the same ECUs on real CAN",
    },
    OutOfScope {
        place: "V, future work",
        what: "SOTIF-related traffic regulations",
        why: "the paper names none, so there is nothing to hold against",
    },
    OutOfScope {
        place: "Fig. 18",
        what: "Speedgoat and iHawk themselves",
        why: "two processes and a CAN bus play their parts",
    },
    OutOfScope {
        place: "Figs. 5, 6, 9, 10, 13 to 15, 19, 20",
        what: "the curves' own values",
        why: "the source has no data; only what the text says of them is compared",
    },
];
