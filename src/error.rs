//! The one public error: what went wrong, where, and what would be allowed.
//!
//! An [`Error`] carries its context as data (file, line, key, value, allowed range), so that a
//! caller can show it in its own way; [`std::fmt::Display`] puts it into one line, or two with
//! a hint. What it was caused by, where that is another library's error or the operating system's,
//! is its [`source`](std::error::Error::source); the one line says it too. Whether a search stopped
//! early is a status, not an error.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What sort of thing went wrong. Use the predicates of [`Error`] to branch on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ErrorKind {
    /// A value, key or file given by the user is not acceptable.
    Input,
    /// The operating system refused to read or write.
    Io,
    /// The inputs are valid, but no schedule can satisfy them.
    Infeasible,
    /// A computation lost its footing (definiteness, finiteness) and refuses to answer.
    Numerical,
    /// Two independent computations of the same number differ by more than allowed.
    Disagreement,
}

/// Why a call failed, with its context.
///
/// ```
/// use scheme_opt::internals::platform::PlatformConfig;
/// let mut config = PlatformConfig::default();
/// config.site.latitude_deg = 95.0;
/// let error = config.check().unwrap_err();
/// assert!(error.is_input());
/// assert_eq!(error.key(), Some("site.latitude_deg"));
/// assert_eq!(error.allowed(), Some("-90 to 90"));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Error(Box<Details>);

#[derive(Debug, Clone, PartialEq)]
struct Details {
    kind: ErrorKind,
    message: String,
    file: Option<PathBuf>,
    line: Option<usize>,
    key: Option<String>,
    value: Option<String>,
    allowed: Option<String>,
    hint: Option<String>,
    cause: Option<Cause>,
}

/// What an error was caused by. Shared, because an [`Error`] can be cloned and its cause need not.
#[derive(Debug, Clone)]
struct Cause(Arc<dyn std::error::Error + Send + Sync>);

/// Causes of other libraries cannot be compared but for what they say.
impl PartialEq for Cause {
    fn eq(&self, other: &Self) -> bool {
        self.0.to_string() == other.0.to_string()
    }
}

/// The result of a fallible call of this crate.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    fn new(kind: ErrorKind, message: impl Into<String>) -> Self {
        Self(Box::new(Details {
            kind,
            message: message.into(),
            file: None,
            line: None,
            key: None,
            value: None,
            allowed: None,
            hint: None,
            cause: None,
        }))
    }

    /// An unacceptable input, described by `message`.
    pub fn input(message: impl Into<String>) -> Self {
        Self::new(ErrorKind::Input, message)
    }

    /// An operating-system failure on `file`, which stays its
    /// [`source`](std::error::Error::source).
    ///
    /// ```
    /// use std::error::Error as _;
    /// let denied = std::io::Error::from(std::io::ErrorKind::PermissionDenied);
    /// let error = scheme_opt::Error::io("read the file", "platform.toml".as_ref(), denied);
    /// let source = error.source().and_then(|s| s.downcast_ref::<std::io::Error>());
    /// assert_eq!(source.map(std::io::Error::kind), Some(std::io::ErrorKind::PermissionDenied));
    /// ```
    pub fn io(action: &str, file: &Path, source: std::io::Error) -> Self {
        Self::new(ErrorKind::Io, format!("cannot {action}: {source}"))
            .with_file(file)
            .with_source(source)
    }

    /// Valid inputs that no schedule satisfies.
    pub fn infeasible(message: impl Into<String>) -> Self {
        Self::new(ErrorKind::Infeasible, message)
    }

    /// A computation that cannot give a trustworthy number.
    pub fn numerical(message: impl Into<String>) -> Self {
        Self::new(ErrorKind::Numerical, message)
    }

    /// Two independent computations that should agree and do not.
    pub fn disagreement(message: impl Into<String>) -> Self {
        Self::new(ErrorKind::Disagreement, message)
    }

    /// An input `key` whose `value` lies outside what is `allowed`.
    pub fn out_of_range(key: &str, value: impl fmt::Display, allowed: &str) -> Self {
        Self::input("value out of range")
            .with_key(key)
            .with_value(value)
            .with_allowed(allowed)
    }

    /// Names the file the error is about.
    #[must_use]
    pub fn with_file(mut self, file: impl Into<PathBuf>) -> Self {
        self.0.file = Some(file.into());
        self
    }

    /// Names the line (from 1) in the file.
    #[must_use]
    pub fn with_line(mut self, line: usize) -> Self {
        self.0.line = Some(line);
        self
    }

    /// Names the key, in dotted form (`site.latitude_deg`, `positions[3].dwell_s`).
    #[must_use]
    pub fn with_key(mut self, key: impl Into<String>) -> Self {
        self.0.key = Some(key.into());
        self
    }

    /// Gives the value found.
    #[must_use]
    pub fn with_value(mut self, value: impl fmt::Display) -> Self {
        self.0.value = Some(value.to_string());
        self
    }

    /// Says what would be allowed.
    #[must_use]
    pub fn with_allowed(mut self, allowed: impl Into<String>) -> Self {
        self.0.allowed = Some(allowed.into());
        self
    }

    /// Adds advice on a line of its own.
    #[must_use]
    pub fn with_hint(mut self, hint: impl Into<String>) -> Self {
        self.0.hint = Some(hint.into());
        self
    }

    /// Keeps what it was caused by.
    #[must_use]
    pub fn with_source(
        mut self,
        source: impl Into<Box<dyn std::error::Error + Send + Sync>>,
    ) -> Self {
        self.0.cause = Some(Cause(source.into().into()));
        self
    }

    /// The sort of failure.
    pub fn kind(&self) -> ErrorKind {
        self.0.kind
    }

    /// True when something the user gave is not acceptable.
    pub fn is_input(&self) -> bool {
        self.0.kind == ErrorKind::Input
    }

    /// True when reading or writing failed.
    pub fn is_io(&self) -> bool {
        self.0.kind == ErrorKind::Io
    }

    /// True when the inputs are valid but cannot be satisfied together.
    pub fn is_infeasible(&self) -> bool {
        self.0.kind == ErrorKind::Infeasible
    }

    /// True when a computation refused to answer.
    pub fn is_numerical(&self) -> bool {
        self.0.kind == ErrorKind::Numerical
    }

    /// True when two independent computations differ.
    pub fn is_disagreement(&self) -> bool {
        self.0.kind == ErrorKind::Disagreement
    }

    /// The file concerned, if any.
    pub fn file(&self) -> Option<&Path> {
        self.0.file.as_deref()
    }

    /// The line concerned (from 1), if known.
    pub fn line(&self) -> Option<usize> {
        self.0.line
    }

    /// The key concerned, in dotted form, if any.
    pub fn key(&self) -> Option<&str> {
        self.0.key.as_deref()
    }

    /// The value found, if any.
    pub fn value(&self) -> Option<&str> {
        self.0.value.as_deref()
    }

    /// What would be allowed, if known.
    pub fn allowed(&self) -> Option<&str> {
        self.0.allowed.as_deref()
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let c = &*self.0;
        if let Some(file) = &c.file {
            write!(f, "{}", file.display())?;
            if let Some(line) = c.line {
                write!(f, ":{line}")?;
            }
            write!(f, ": ")?;
        }
        match (&c.key, &c.value) {
            (Some(key), Some(value)) => write!(f, "{key} = {value}: ")?,
            (Some(key), None) => write!(f, "{key}: ")?,
            (None, Some(value)) => write!(f, "{value}: ")?,
            (None, None) => {}
        }
        write!(f, "{}", c.message)?;
        if let Some(allowed) = &c.allowed {
            write!(f, "; allowed: {allowed}")?;
        }
        if let Some(hint) = &c.hint {
            write!(f, "\n  hint: {hint}")?;
        }
        Ok(())
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        let cause = self.0.cause.as_ref()?;
        Some(&*cause.0)
    }
}

#[cfg(test)]
mod tests {
    use std::error::Error as _;

    use super::*;
    use crate::config::StudySource;
    use crate::schedule::file::{from_csv, from_json};

    /// The cause of an error, of the kind that is expected.
    fn cause<E: std::error::Error + 'static>(error: &Error) -> &E {
        let source = error
            .source()
            .unwrap_or_else(|| panic!("no cause: {error}"));
        source
            .downcast_ref()
            .unwrap_or_else(|| panic!("another cause: {source:?}"))
    }

    #[test]
    fn errors_keep_their_cause() {
        let missing = StudySource::read("no-such-directory/platform.toml".as_ref()).unwrap_err();
        assert!(missing.is_io());
        assert_eq!(
            cause::<std::io::Error>(&missing).kind(),
            std::io::ErrorKind::NotFound
        );

        // Neither TOML nor a value of the type of its key.
        for text in ["[site\n", "[site]\nlatitude_deg = \"north\"\n"] {
            let error = StudySource::parse(text, None).unwrap_err();
            assert!(!cause::<toml::de::Error>(&error).message().is_empty());
        }

        let error = from_json("{\"schema\": ").unwrap_err();
        assert!(cause::<serde_json::Error>(&error).is_eof());

        let error = from_csv("alpha_deg,beta_deg,gamma_deg,dwell_s\n0,0,x,10\n").unwrap_err();
        assert_eq!(
            cause::<std::num::ParseFloatError>(&error),
            &"x".parse::<f64>().unwrap_err()
        );
    }

    #[test]
    fn a_cause_goes_with_the_error_and_says_nothing_twice() {
        let full = || std::io::Error::other("the disk is full");
        let error = Error::io("write the file", Path::new("result.json"), full());
        assert_eq!(
            error.to_string(),
            "result.json: cannot write the file: the disk is full"
        );
        let copy = error.clone();
        assert_eq!(
            cause::<std::io::Error>(&copy).to_string(),
            "the disk is full"
        );
        assert_eq!(copy, error);
        let other = Error::io("write the file", Path::new("result.json"), full());
        assert_eq!(other, error);
        assert!(Error::input("wrong type").source().is_none());
        assert_ne!(Error::input("a"), Error::input("a").with_source(full()));
        // A chain of this crate's own errors.
        let outer = Error::infeasible("no").with_source(error.clone());
        assert_eq!(cause::<Error>(&outer), &error);
    }
}
