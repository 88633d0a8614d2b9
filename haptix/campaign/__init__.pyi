from .kinds import Campaign as Campaign
from .kinds import CampaignTask as CampaignTask
from .kinds import load_campaign as load_campaign
from .run import CampaignResult as CampaignResult
from .run import run_campaign as run_campaign
