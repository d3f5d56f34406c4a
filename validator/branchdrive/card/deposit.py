"""What archives ask about a dataset that is deposited there: Zenodo's `.zenodo.json`, and `codemeta.json`.

Source: developers.zenodo.org (deposit metadata), codemeta.github.io (3.0).
"""

from __future__ import annotations

from typing import Any

from branchdrive.card.licence import licence_urls
from branchdrive.contract.descriptor import Descriptor

__all__ = ["codemeta", "zenodo"]

Json = dict[str, Any]


def zenodo(descriptor: Descriptor) -> Json:
    """Metadata of a deposit at Zenodo, which asks for creators where the descriptor names none."""
    related = [{"identifier": descriptor.url, "relation": "isIdenticalTo"}] if descriptor.url else None
    return _said(
        upload_type="dataset",
        title=descriptor.title,
        description=descriptor.description or descriptor.title,
        version=descriptor.dataset_version,
        creators=[{"name": name} for name in descriptor.creators],
        license=descriptor.licence.lower() if len(licence_urls(descriptor.licence)) == 1 else None,
        keywords=[*descriptor.keywords],
        doi=descriptor.doi,
        related_identifiers=related,
        references=[descriptor.citation] if descriptor.citation else None,
    )


def codemeta(descriptor: Descriptor) -> Json:
    """The dataset in the terms of CodeMeta, with the software that made it."""
    made = [
        {"@type": "SoftwareApplication", "name": software.name, "softwareVersion": software.version}
        for software in (descriptor.simulator, descriptor.collector)
    ]
    return {
        "@context": "https://w3id.org/codemeta/3.0",
        "@type": "Dataset",
        **_said(
            name=descriptor.title,
            identifier=f"https://doi.org/{descriptor.doi}" if descriptor.doi else descriptor.dataset_id,
            description=descriptor.description or descriptor.title,
            version=descriptor.dataset_version,
            license=licence_urls(descriptor.licence) or descriptor.licence,
            author=[{"@type": "Organization", "name": name} for name in descriptor.creators],
            keywords=[*descriptor.keywords],
            url=descriptor.url,
            citation=descriptor.citation,
            isBasedOn=made,
        ),
    }


def _said(**values: Any) -> Json:
    """Members that say something."""
    return {name: value for name, value in values.items() if value not in (None, [])}
