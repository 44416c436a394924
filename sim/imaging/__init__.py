"""Image formation: from radiance layers to digital numbers (DN)."""
