//! Every claim of the paper's results, in its order, beside what we measured.

mod avoidance;
mod comparison;
mod experiment;
mod merging;
mod platooning;

pub use comparison::TABLE_III;

use super::claim::Claim;
use super::design::Evidence;
use super::improvement::Improvement;
use super::uniformity::Uniformity;

/// Every claim whose runs were made.
pub fn claims(
    evidence: &Evidence<'_>,
    improvements: &[Improvement],
    uniformity: Option<&Uniformity>,
) -> Vec<Claim> {
    let mut claims = platooning::claims(evidence, uniformity);
    claims.extend(merging::claims(evidence));
    claims.extend(avoidance::claims(evidence));
    claims.extend(comparison::claims(evidence, improvements));
    claims.extend(experiment::claims(evidence));
    claims
}
