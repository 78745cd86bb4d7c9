"""Every error that eskin raises on purpose.

    EskinError
    ├── IntervalError            bounds that are no interval, or shapes that do not fit
    ├── MissingExtraError        a library that is not installed, as few need it
    ├── SettingsError            a configuration that cannot be used
    ├── MessageError             bytes that are no message of the wire contract
    ├── CommandError             a command that asks for what is not allowed
    ├── EnvelopeError            a sealed message that cannot be trusted
    │   ├── MalformedEnvelopeError
    │   ├── UnknownSenderError
    │   ├── UnknownRecipientError
    │   └── ForgedEnvelopeError
    ├── IdentityError            keys or certificates that cannot be used
    │   ├── UntrustedCertificateError
    │   └── AuthorityError       a CA whose own files cannot be used
    ├── PrivacyError             biometric data that cannot be encrypted or decrypted
    │   └── NoKeyError
    ├── LockedError              a file that another process owns
    ├── FirmwareError            a node's firmware that failed while it ran
    ├── FlashError               a node's flash that cannot hold or give back
    ├── SpoolError               a gateway's spool that cannot hold or give back
    ├── CloudError               a cloud that did not answer as agreed
    ├── StoreError               a cloud's store that cannot hold or give back
    ├── QueryError               a question that has no answer as it stands
    ├── DesignError              a requirement, or a space of parameters, that cannot be used
    ├── ContactError             a skin, a threshold or times by which contacts cannot be sought
    ├── GestureError             templates by which gestures cannot be sought
    ├── MonitorError             a formula, or signals, that a monitor cannot use
    ├── IdentificationError      constraints or bounds from which no parameter can be enclosed
    ├── ScenarioError            a scenario that cannot be played
    ├── RecordingError           a recording that cannot be replayed, or not all of it
    └── AuditError               a data folder that cannot be audited

A message says what happened, where, with which value, and what to do. Facts that a program may
want are attributes, too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path


def shown(value: object) -> str:
    """A value as a message shows it, whatever a peer sent."""
    try:
        text = repr(value)
    except ValueError:  # an integer of thousands of digits
        text = f"a very long {type(value).__name__}"
    return text if len(text) <= 80 else f"{text[:77]}..."


def unprefixed(message: str) -> str:
    """What a validator of ours raised, without the prefix that pydantic puts before it."""
    return message.replace("Value error, ", "")


class EskinError(Exception):
    """Root of all errors that eskin raises on purpose."""


class IntervalError(EskinError, ValueError):
    """Bounds that are no interval (lo > hi, NaN), or shapes that do not fit each other."""


class MissingExtraError(EskinError, ImportError):
    """A library that is not installed, as few need it."""

    def __init__(self, what: str, library: str, requirement: str) -> None:
        super().__init__(
            f"{what} needs {library}, which is not installed: pip install '{requirement}'"
        )
        self.library = library


class SettingsError(EskinError):
    """A configuration that cannot be used.

    Attributes:
        setting: Dotted name of the setting, such as ``broker.port``.
    """

    def __init__(self, setting: str, reason: str) -> None:
        super().__init__(f"{setting}: {reason}")
        self.setting = setting


class MessageError(EskinError):
    """Bytes that are no message of the wire contract (``docs/eskin.cddl``)."""


class CommandError(EskinError):
    """A command that asks for what is not allowed.

    Attributes:
        field: Which of its arguments.
        value: What it asks for; ``None`` where something is missing.
        allowed: What may be asked for.
    """

    def __init__(self, field: str, value: object, allowed: str) -> None:
        asked = "missing" if value is None else shown(value)
        super().__init__(f"{field} is {asked}; allowed: {allowed}")
        self.field = field
        self.value = value
        self.allowed = allowed


class EnvelopeError(EskinError):
    """A sealed message that cannot be trusted."""


class MalformedEnvelopeError(EnvelopeError):
    """Bytes that are no COSE_Encrypt0 of ours."""


class UnknownSenderError(EnvelopeError):
    """The envelope names a sender's certificate that is not known here.

    Attributes:
        thumbprint: SHA-256 of the sender's certificate (DER).
    """

    def __init__(self, thumbprint: bytes) -> None:
        super().__init__(
            f"no certificate known for sender thumbprint {thumbprint.hex()}; "
            "it arrives with the node's next status"
        )
        self.thumbprint = thumbprint


class UnknownRecipientError(EnvelopeError):
    """The envelope is sealed to a key that is not held here.

    Attributes:
        thumbprint: SHA-256 of the recipient's certificate (DER).
    """

    def __init__(self, thumbprint: bytes) -> None:
        super().__init__(
            f"sealed to thumbprint {thumbprint.hex()}, which is no key of this process; "
            "check which site the sender was configured for"
        )
        self.thumbprint = thumbprint


class ForgedEnvelopeError(EnvelopeError):
    """Authentication failed: other key, other topic, or altered bytes."""


class IdentityError(EskinError):
    """A key or certificate that cannot be read, made or used."""


class UntrustedCertificateError(IdentityError):
    """A certificate chain that does not lead to the CA that it must lead to."""


class AuthorityError(IdentityError):
    """A CA's own files cannot be read or written; the request is not at fault."""


class PrivacyError(EskinError):
    """Biometric data cannot be encrypted or decrypted; the text never holds them."""


class BrokenSealError(PrivacyError):
    """Encrypted data were changed, moved or damaged."""


class KeyConflictError(PrivacyError):
    """A subject's key that is given is another one than the one that is kept."""


class NoKeyError(PrivacyError):
    """A subject whose key is not here: it was erased, or never given.

    Attributes:
        subject: The pseudonym.
        erased: Whether it was erased.
    """

    def __init__(self, subject: str, *, erased: bool) -> None:
        why = "was erased: its key is destroyed" if erased else "has no key here"
        super().__init__(f"subject {subject} {why}")
        self.subject = subject
        self.erased = erased


class LockedError(EskinError):
    """A file that another process owns.

    Attributes:
        path: The file.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(f"{path}: another process uses it; stop that one first")
        self.path = path


class FirmwareError(EskinError):
    """A node's firmware that failed while it ran; only its machine stops, until a reset."""


class FlashError(EskinError):
    """A node's flash that cannot hold or give back a message."""


class SpoolError(EskinError):
    """A gateway's spool that cannot hold or give back a message."""


class CloudError(EskinError):
    """A cloud that did not answer a gateway, or a client, as agreed.

    Attributes:
        status: HTTP status, where there was an answer.
        retry_after: Seconds for which the cloud asked for patience.
        unanswered: Whether the cloud was reached, and gave no answer in time.
    """

    def __init__(
        self,
        reason: str,
        *,
        status: int | None = None,
        retry_after: float | None = None,
        unanswered: bool = False,
    ) -> None:
        super().__init__(reason)
        self.status = status
        self.retry_after = retry_after
        self.unanswered = unanswered


class StoreError(EskinError):
    """A cloud's store that cannot hold or give back data."""


class QueryError(EskinError):
    """A question that has no answer as it stands.

    Attributes:
        parameter: Name of the parameter at fault, such as ``start``.
    """

    def __init__(self, parameter: str, reason: str) -> None:
        super().__init__(f"{parameter}: {reason}")
        self.parameter = parameter


class DesignError(EskinError, ValueError):
    """A requirement, or a space of parameters, that cannot be used."""


class ContactError(EskinError, ValueError):
    """A skin, a threshold or times by which contacts cannot be sought."""


class GestureError(EskinError, ValueError):
    """Templates by which gestures cannot be sought."""


class IdentificationError(EskinError, ValueError):
    """Constraints, times or bounds from which no parameter can be enclosed."""


class MonitorError(EskinError, ValueError):
    """A formula, or signals, that a monitor cannot use.

    Attributes:
        column: Where in the formula's text, from 1; ``None`` where there is no text.
        value: What cannot be used.
    """

    def __init__(self, reason: str, *, column: int | None = None, value: object = None) -> None:
        super().__init__(reason if column is None else f"column {column}: {reason}")
        self.reason = reason
        self.column = column
        self.value = value


class ScenarioError(EskinError):
    """A scenario that cannot be played.

    Attributes:
        file: The scenario.
        place: Where in it, such as ``event 3 (slide).path``.
    """

    def __init__(self, file: Path | str, place: str, reason: str) -> None:
        super().__init__(f"{file}: {place}: {reason}")
        self.file = file
        self.place = place


class RecordingError(EskinError):
    """A recording that cannot be replayed, or not all of it.

    Attributes:
        file: The recording.
        place: Where in it, such as ``line 17``.
    """

    def __init__(self, file: Path | str, place: str, reason: str) -> None:
        super().__init__(f"{file}: {place}: {reason}")
        self.file = file
        self.place = place


class AuditError(EskinError):
    """A data folder that cannot be audited."""
