import sys,math,collections
S=collections.defaultdict(lambda:[0,0,0,0,0.]);
for fn in sys.argv[1:]:
  wk={};pos={};dist=collections.Counter();ns=collections.Counter();T={};bat={};fg=collections.Counter()
  for l in open(fn):
    w=l.split(None,5)
    if not w: continue
    if w[0]=='Y': wk[w[1]]='Walker {' in l
    elif w[0]=='P':
        x=l.split();p=(float(x[3]),float(x[4]));k=x[1]
        if k in pos: dist[k]+=math.hypot(p[0]-pos[k][0],p[1]-pos[k][1])
        pos[k]=p;T[k]=float(x[2]);bat[k]=float(x[6])
    elif w[0]=='E':
        if 'Engine(Dock)' in l and w[3]=='Heard': ns[w[1]]+=1
        if ' F forget' in l: fg[w[1]]+=1
  for k in wk:
    s=S[wk[k]];s[0]+=1;s[1]+=ns[k];s[2]+=dist[k];s[3]+=T[k];s[4]+=fg[k]
for k,s in S.items(): print('walker' if k else 'none','runs',s[0],'searches/run %.1f'%(s[1]/s[0]),'m/search %.2f'%(s[2]/s[1]),'s/search %.1f'%(s[3]/s[1]),'forgets/run %.1f'%(s[4]/s[0]))
