from relight.photos.mask.find import find_mask as find_mask
