"""Monitors over stored channels: formulas, two channels compared, predictions."""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import TYPE_CHECKING, Any, Final, Literal

from eskin.client.http import API
from eskin.errors import QueryError
from eskin.interval import Interval
from eskin.interval.conversion import enclose

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eskin.client.http import HttpClient

_EPOCH: Final = datetime.fromisoformat("1970-01-01T00:00:00+00:00")

Instant = datetime | int | str
"""An instant: with a time zone, as UTC ns since 1970, or in RFC 3339."""


def written_instants(**instants: Instant | None) -> dict[str, str]:
    """Parameters of a question, by name; what is ``None`` is left out.

    Raises:
        QueryError: An instant has no time zone.
    """
    given = {name: instant for name, instant in instants.items() if instant is not None}
    return {name: _written(name, instant) for name, instant in given.items()}


def _written(parameter: str, instant: Instant) -> str:
    if not isinstance(instant, datetime):
        return str(instant)
    if instant.tzinfo is None:
        raise QueryError(parameter, f"{instant} has no time zone; give it one, such as UTC")
    return str((instant - _EPOCH) // timedelta(microseconds=1) * 1000)


_JSON = "application/json"


class Queries:
    """Questions to a cloud; a window that is left out is the last minute of data.

    Args:
        pages: Asks the cloud.
    """

    def __init__(self, pages: HttpClient) -> None:
        self._pages = pages

    def comparison(
        self,
        node: str,
        channel: str,
        other: str,
        *,
        state: Literal["above", "below"] = "above",
        start: Instant | None = None,
        end: Instant | None = None,
    ) -> list[dict[str, Any]]:
        """When a channel is above or below another, ``certain`` or ``possible``, in order of time.

        Args:
            node: Such as ``fingertip``.
            channel: Such as ``t01.capacitance``.
            other: The other channel, as ``NODE/CHANNEL``, of the same unit.
            state: What is asked of the channel.
            start: Included.
            end: Excluded.

        Raises:
            QueryError: An instant without a time zone.
            CloudError: The cloud refused, or did not answer.
        """
        params = written_instants(start=start, end=end) | {"other": other, "state": state}
        return list(self._pages.items(_path(node, channel, "comparison"), params))

    def comparison_time(
        self,
        node: str,
        channel: str,
        other: str,
        *,
        state: Literal["above", "below"] = "above",
        start: Instant | None = None,
        end: Instant | None = None,
    ) -> dict[str, Any]:
        """For how long (s) and how often: intervals; arguments and errors as `comparison`."""
        params = written_instants(start=start, end=end) | {"other": other, "state": state}
        return self._ask(_path(node, channel, "comparison/time"), params)

    def verdicts(
        self,
        formula: str,
        *,
        node: str | None = None,
        verdict: Literal["impossible", "possible", "certain"] | None = None,
        start: Instant | None = None,
        end: Instant | None = None,
    ) -> list[dict[str, Any]]:
        """When a formula over stored channels has which verdict, in order of time.

        Args:
            formula: Signal temporal logic with bounded windows, such as
                ``always[0,50ms](t01.capacitance > 50 pF)``.
            node: Of channels without one; others are ``"NODE/CHANNEL"`` in double quotes.
            verdict: Only stretches with this one.
            start: Included.
            end: Excluded.

        Raises:
            QueryError: An instant without a time zone.
            CloudError: The cloud refused, or did not answer.
        """
        params = written_instants(start=start, end=end) | {"formula": formula}
        params |= {} if node is None else {"node": node}
        params |= {} if verdict is None else {"verdict": verdict}
        return list(self._pages.items(f"{API}/monitors/evaluation", params))

    def verdict_time(
        self,
        formula: str,
        *,
        node: str | None = None,
        start: Instant | None = None,
        end: Instant | None = None,
    ) -> dict[str, Any]:
        """For how long (s) and how often a formula holds: intervals; arguments as `verdicts`."""
        params = written_instants(start=start, end=end) | {"formula": formula}
        params |= {} if node is None else {"node": node}
        return self._ask(f"{API}/monitors/evaluation/time", params)

    def monitors(self) -> list[dict[str, Any]]:
        """The monitors that the cloud evaluates live, each with its latest verdict.

        Raises:
            CloudError: The cloud refused, or did not answer.
        """
        return list(self._pages.items(f"{API}/monitors"))

    def node_monitors(self, node: str) -> list[dict[str, Any]]:
        """The monitors that run on a node, each with its latest verdict and its output's level.

        Args:
            node: Such as ``fingertip``.

        Raises:
            CloudError: As `monitors`.
        """
        return list(self._pages.items(f"{API}/nodes/{node}/monitors"))

    def alarms(
        self, *, monitor: str | None = None, state: Literal["raised", "cleared"] | None = None
    ) -> list[dict[str, Any]]:
        """Alarms of monitors, the latest first.

        Args:
            monitor: Those of one monitor only.
            state: Only those that are raised now, or that are cleared.

        Raises:
            CloudError: The cloud refused, or did not answer.
        """
        params = {} if monitor is None else {"monitor": monitor}
        params |= {} if state is None else {"state": state}
        return list(self._pages.items(f"{API}/alarms", params))

    def define_monitor(
        self,
        name: str,
        formula: str,
        *,
        node: str | None = None,
        raise_on: Literal["never", "possible", "certain"] = "certain",
        severity: str = "warning",
    ) -> dict[str, Any]:
        """Have the cloud evaluate a formula live; the token needs the scope ``operate``.

        Args:
            name: Of the monitor: small letters, digits and dashes.
            formula: As of `verdicts`.
            node: Of channels without one.
            raise_on: The least verdict that raises an alarm.
            severity: What receivers of alarms are given with it.

        Returns:
            The monitor.

        Raises:
            CloudError: The cloud refused, or did not answer.
        """
        body = {"formula": formula, "node": node, "raise_on": raise_on, "severity": severity}
        found: dict[str, Any] = self._pages.put(f"{API}/monitors/{name}", body).json()
        return found

    def anomalies(
        self,
        node: str,
        channel: str,
        model: str,
        parameters: Mapping[str, Interval | float],
        *,
        origin: Instant | None = None,
        start: Instant | None = None,
        end: Instant | None = None,
    ) -> list[dict[str, Any]]:
        """When a channel is not as a model predicts, ``certain`` or ``possible``, in order of time.

        Args:
            node: Such as ``palm``.
            channel: Such as ``t01.capacitance``.
            model: A quantity of a model, such as ``touch.capacitance``.
            parameters: The model's parameters by name, in SI units.
            origin: The model's time 0; else ``start``. One of both is needed, but by a constant.
            start: Included.
            end: Excluded.

        Raises:
            QueryError: An instant without a time zone.
            CloudError: The cloud refused, or did not answer.
        """
        params = written_instants(origin=origin, start=start, end=end) | _model(model, parameters)
        return list(self._pages.items(_path(node, channel, "anomalies"), params))

    def anomalies_time(
        self,
        node: str,
        channel: str,
        model: str,
        parameters: Mapping[str, Interval | float],
        *,
        origin: Instant | None = None,
        start: Instant | None = None,
        end: Instant | None = None,
    ) -> dict[str, Any]:
        """For how long (s) and how often: intervals; arguments and errors as `anomalies`."""
        params = written_instants(origin=origin, start=start, end=end) | _model(model, parameters)
        return self._ask(_path(node, channel, "anomalies/time"), params)

    def prediction(
        self,
        node: str,
        channel: str,
        model: str,
        parameters: Mapping[str, Interval | float],
        *,
        origin: Instant | None = None,
        start: Instant | None = None,
        end: Instant | None = None,
        points: int = 1000,
    ) -> dict[str, Any]:
        """What a model predicts, as hulls over at most ``points`` buckets; else as `anomalies`."""
        params = written_instants(origin=origin, start=start, end=end) | _model(model, parameters)
        return self._ask(_path(node, channel, "prediction"), params | {"points": points})

    def _ask(self, path: str, params: Mapping[str, Any]) -> dict[str, Any]:
        found: dict[str, Any] = self._pages.get(path, params, accept=_JSON).json()
        return found


def _path(node: str, channel: str, question: str) -> str:
    return f"{API}/series/{node}/{channel}/{question}"


def _model(model: str, parameters: Mapping[str, Interval | float]) -> dict[str, Any]:
    bounds = {
        name: value if isinstance(value, Interval) else Interval(*enclose(value, name))
        for name, value in parameters.items()
    }
    written = [f"{name}:{float(b.inf)!r}:{float(b.sup)!r}" for name, b in bounds.items()]
    return {"model": model, "parameter": written}
