"""Every error the daemon raises on purpose, beside those of the driver."""

from x2radar.errors import BriefError


class RadardError(BriefError):
    """Base of all errors raised on purpose; `exit_code` is what the command ends with."""

    exit_code = 1


class UsageError(RadardError, ValueError):
    """An option or value that makes no sense."""

    exit_code = 2


class ConfigError(RadardError):
    """A configuration file or environment variable is wrong."""

    exit_code = 78


class BundleError(RadardError):
    """A model bundle is missing or unreadable."""

    exit_code = 66


class ModelMismatch(RadardError):
    """A bundle that does not fit the stream, or is not what its sidecar says."""

    exit_code = 4


class OutputError(RadardError):
    """A sink cannot keep what it is given."""


class NotAllowed(RadardError):
    """What only root may do, or the user that the daemon belongs to."""

    exit_code = 77


class FeatureError(ModelMismatch, ValueError):
    """An array that a signal-processing routine cannot take: the stream does not fit."""
