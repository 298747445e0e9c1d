"""What loaders of datasets share: images, depth maps, cameras and charts in files, decoded when they are asked for."""
