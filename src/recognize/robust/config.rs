//! Configuration of the robust recognizer: the expected views, and the extent of the search.

use crate::error::{Result, require};
use crate::view::ViewModel;

/// What the recognizer expects of the views, and the extent of its search.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct RobustConfig {
    /// What is expected of a view. The noise's size is that of the observed dots, not this model's.
    #[serde(flatten)]
    pub view: ViewModel,
    /// Maximum number of pairs of observed dots that the search aligns with the pattern.
    pub passes: usize,
    /// Probability of the pose below which a view is also searched mirrored; 1 searches every view.
    pub mirror_doubt: f64,
    /// Probability of the names below which the likely explanations are integrated over their rotations, which their
    /// confidences need. 0 integrates none: the orientation is hardly ever another, its confidence less exact.
    pub integrated_below: f64,
}

impl Default for RobustConfig {
    /// The default view; at most 64 pairs; mirrored where the pose is less likely than 0.9; integrated where the names
    /// are less likely than 0.9995.
    fn default() -> Self {
        Self::from(ViewModel::default())
    }
}

impl From<ViewModel> for RobustConfig {
    /// This view with the default extent of the search.
    fn from(view: ViewModel) -> Self {
        Self {
            view,
            passes: 64,
            mirror_doubt: 0.9,
            integrated_below: 0.9995,
        }
    }
}

impl RobustConfig {
    /// Checks the domains of all parameters.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) naming the parameter.
    pub fn check(&self) -> Result<()> {
        self.view.check()?;
        require(self.passes > 0, "passes", "1 or more", self.passes)?;
        for (name, p) in [
            ("mirror_doubt", self.mirror_doubt),
            ("integrated_below", self.integrated_below),
        ] {
            require((0.0..=1.0).contains(&p), name, "a probability", p)?;
        }
        Ok(())
    }
}
