"""Base of configuration sections: strict models, bounds on numbers, choice by ``kind``, a walk over all."""
