"""fleetsight: what every robot of a warehouse fleet sees, known centrally."""

from fleetsight import own_packages

own_packages.put_first(own_packages.CLIENT)
